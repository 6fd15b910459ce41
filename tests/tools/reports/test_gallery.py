"""The page of overlays: every photograph once, and none of its content where it must not be shown."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from PIL import Image

from tests.support.colour_code import colour_code, write_picture
from tools.reports import gallery


def test_plain_page_shows_smears_but_no_photograph(
    tmp_path: Path, tiny_model: Path, call_tool: Callable[[str], None]
) -> None:
    phi = np.mgrid[:96, :128].sum(0) * 0.01
    picture = colour_code(12 * np.stack([np.cos(phi), np.sin(phi)], -1), 1.0)
    paths = " ".join(str(write_picture(tmp_path / f"{k}.png", picture)) for k in range(3))
    pages = []
    for flags in ("", "--plain"):
        call_tool(f"reports.gallery {paths} --out {tmp_path}/page.webp --model {tiny_model} {flags}")
        pages.append(np.asarray(Image.open(tmp_path / "page.webp").convert("RGB"), float))
    shown, plain = pages
    assert shown.shape == plain.shape and shown.shape[1] == gallery.COLUMNS * gallery.TILE_PX
    right = shown[shown.shape[0] * 2 // 3 + 8 :, gallery.TILE_PX + 8 :]
    assert right.max() < 8  # three photographs leave the last place empty
    places = np.s_[40:400, 8:632]
    assert np.median(plain[places].astype(float).std(2)) == 0  # only smears are coloured
    assert (shown[places] != plain[places]).mean() > 0.5
