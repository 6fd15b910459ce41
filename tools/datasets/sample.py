"""Make the photographs that ship in ``models/``.

``python -m tools.datasets.sample models/sample.jpg --photos KODAK`` renders the sample of a moving camera,
``python -m tools.datasets.sample models/sample_mover.jpg --photos KODAK --mover`` a photograph that a camera
moved before, with a piece of another one that moved otherwise; both give the same bytes again.
"""

from dataclasses import replace

import cv2
import numpy as np

from tools.arguments import Existing, Target, run
from tools.datasets.testset import test_options
from tools.rendering.render import render
from tools.rendering.sensor import SensorOptions, photograph
from tools.rendering.shaken import ShakeOptions, shake
from tools.rendering.textures import read_photograph

SEED = 2_000_048  # cards at several depths, seen by a camera that moves forward
SENSOR_SEED = 4
SMEAR_PX = (10.0, 14.0)
"""Median smear over all surfaces, hidden ones too; those of the visible pixels are shorter."""
MOVER_SEED = 13
MOVER = ShakeOptions(
    size=(720, 480), smear_px=(8.0, 20.0), short_share=0.0, still_share=0.0, mover_share=1.0, rest_share=0.0,
    focus_share=0.0,
)  # fmt: skip
QUALITY = 92


def main(target: Target, *, photos: Existing | None = None, mover: bool = False) -> None:
    """Write a sample of the Kodak photographs: of a moving camera, or the one in which something moves."""
    lens = SensorOptions(jpeg_share=0.0)
    if not mover:
        options = replace(test_options(photos, (960, 540)), smear_px=SMEAR_PX, mover_share=0.0)
        linear = render(SEED, options).linear
    elif photos is None:
        raise SystemExit("--mover needs --photos")
    else:
        surfaces = [read_photograph(path) for path in sorted(photos.rglob("*.png"))]
        linear = shake(np.random.default_rng(MOVER_SEED), surfaces, MOVER).linear
        lens = replace(lens, defocus_share=0.0)
    picture = photograph(np.random.default_rng(SENSOR_SEED), linear, lens)
    cv2.imwrite(str(target), picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, QUALITY])


if __name__ == "__main__":
    run(main)
