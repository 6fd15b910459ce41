"""The page of overlays: every photograph once, and none of its content where it must not be shown."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from PIL import Image

from tests.support.colour_code import colour_code, write_picture
from tools.reports import gallery
from tools.reports.figure_style import COLOURS, new_figure, save


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
    call_tool(f"reports.gallery {tmp_path}/0.png --out {tmp_path}/page.webp --model {tiny_model}")
    with Image.open(tmp_path / "page.webp") as alone:
        assert alone.width == gallery.ALONE_PX  # the page to itself
    shown, plain = pages
    assert shown.shape == plain.shape
    assert shown.shape[1] == gallery.COLUMNS * gallery.TILE_PX
    right = shown[shown.shape[0] * 2 // 3 + 8 :, gallery.TILE_PX + 8 :]
    assert right.max() < 8  # three photographs leave the last place empty
    places = np.s_[40:400, 8:632]
    assert np.median(plain[places].astype(float).std(2)) == 0  # only smears are coloured
    assert (shown[places] != plain[places]).mean() > 0.5


def test_plots_are_light_and_the_same_again(tmp_path: Path) -> None:
    for name in "ab":
        figure = new_figure(3, 3)
        figure.subplots().imshow(np.random.default_rng(0).random((600, 600)))
        save(figure, tmp_path / f"{name}.png", dpi=200)
    first, again = ((tmp_path / f"{name}.png").read_bytes() for name in "ab")
    assert first == again
    with Image.open(tmp_path / "a.png") as plot:
        assert len(plot.convert("RGB").getcolors(1 << 20) or []) <= COLOURS
