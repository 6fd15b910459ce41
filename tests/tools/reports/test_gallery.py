"""The page of overlays: every photograph once, and none of its content where it must not be shown."""

from pathlib import Path

import numpy as np
import pytest

from tests.support.colour_code import colour_code, write_picture
from tools.reports import gallery


def test_plain_page_shows_smears_but_no_photograph(
    tmp_path: Path, tiny_model: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    phi = np.mgrid[:96, :128].sum(0) * 0.01
    picture = colour_code(12 * np.stack([np.cos(phi), np.sin(phi)], -1), 1.0)
    paths = [write_picture(tmp_path / f"{k}.png", picture) for k in range(3)]
    pages: list[gallery.Picture] = []
    monkeypatch.setattr(gallery, "save_picture", lambda picture, path: pages.append(picture))
    for flags in ("", "--plain"):
        words = f"gallery {' '.join(map(str, paths))} --out page.webp --model {tiny_model} {flags}"
        monkeypatch.setattr("sys.argv", words.split())
        gallery.main()
    shown, plain = pages
    assert shown.shape == plain.shape
    assert shown.shape[1] == gallery.COLUMNS * gallery.TILE_PX
    right = shown[shown.shape[0] * 2 // 3 :, gallery.TILE_PX :]
    assert (right == 0).all()  # three photographs leave the last place empty
    places = np.s_[40:400, 8:632]
    assert np.median(plain[places].astype(float).std(2)) == 0  # only smears are coloured
    assert (shown[places] != plain[places]).mean() > 0.5


def test_photograph_alone_has_the_page_to_itself() -> None:
    alone = np.zeros((60, gallery.ALONE_PX, 3), np.uint8)
    assert gallery.page([alone]) is alone
