"""Photographs blurred in every way that has a name: their truth, and the figures of what is said of them."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from blur2view.smears.blur import Blur
from tools.datasets import blurred_photographs as made
from tools.datasets.blurred_photographs import Picture
from tools.evaluation import blur_kinds


@pytest.fixture(scope="module")
def photographs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder of three small photographs of random grain, each tinted."""
    folder, rng = tmp_path_factory.mktemp("photographs"), np.random.default_rng(0)
    for k in range(3):
        grain = cv2.GaussianBlur(rng.uniform(0, 1, (224, 320)), (0, 0), 0.8)[..., None]
        pixels = 255 * np.clip(0.5 + (grain - 0.5) * 1.5 + 0.1 * np.eye(3)[k], 0, 1)
        assert cv2.imwrite(str(folder / f"{k}.png"), pixels.round().astype(np.uint8))
    return folder


def pictures(folder: Path) -> list[Picture]:
    """Return all pictures of the first photograph of a folder."""
    paths, rng = sorted(folder.iterdir()), np.random.default_rng(0)
    return list(made.pictures_of(rng, made.radiance_of(paths[0]), paths[1:], False, 2))


def truth_of(picture: Picture) -> blur_kinds.Seen:
    """Return a picture of which the truth is said."""
    moves = 0.0 if picture.moving is None else float((picture.moving > 0).mean())
    blur = Blur(
        kind=picture.kind, smear_px=picture.smear_px, defocus_px=picture.radius_px, moving_share=moves
    )
    widths = {"ours: width of the blur": picture.radius_px + picture.smear_px}
    return blur_kinds.Seen(
        picture=replace(picture, file=b"", moving=None), said=blur, blur=widths, moves=moves
    )


@pytest.mark.parametrize(("radius_px", "blades"), [(2, 0), (5, 6), (8, 9)])
def test_an_aperture_has_the_second_moment_of_its_disc_along_every_axis(radius_px: int, blades: int) -> None:
    weights = made.aperture(radius_px, blades, turn=0.3).astype(float)
    reach = len(weights) // 2
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    assert weights.sum() == pytest.approx(1, abs=1e-6) and not weights[0].any() and not weights[:, -1].any()
    assert [(weights * x).sum(), (weights * y).sum()] == pytest.approx([0, 0], abs=0.01)
    moments = [(weights * one).sum() for one in (x * x, y * y, x * y)]
    moment = radius_px**2 / 4 + 1 / 12  # and that of a pixel
    assert moments == pytest.approx([moment, moment, 0], rel=0.01, abs=0.05)


@pytest.mark.slow
def test_whoever_knows_the_truth_has_no_error(photographs: Path) -> None:
    text = blur_kinds.page([truth_of(one) for one in pictures(photographs)])
    assert "| sharp | 1 | 1 | 0 | 0 | 0 | 0 | 0 |" in text
    assert "| out of focus, all that counts as blurred | 6 | 0 | 6 | 0 | 0 | 0 | 0 |" in text
    assert "| camera moved, all that counts as blurred | 5 | 0 | 0 | 5 | 0 | 0 | 0 |" in text
    assert "| discs, from 3 px | 6 | 1.000 | 0.000 | 1.000 |" in text
    assert "| ours: width of the blur | 1.000 | 1.000 | 1.000 | 1.000 | 1.000 | 1.000 |" in text
    assert "| camera moved 12 px, 1/8 | 1 | 0 | 0 | 1 | 0 | 0 | 0 |" in text and "nan" not in text
