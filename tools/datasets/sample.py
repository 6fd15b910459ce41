"""Make the photographs that ship in ``models/``.

``python -m tools.datasets.sample models/sample.jpg --photos KODAK`` renders the sample of a moving camera,
``python -m tools.datasets.sample models/sample_mover.jpg --photos KODAK --mover`` a photograph that a camera
moved before, with a piece of another one that moved otherwise; both give the same bytes again.
"""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from blur2view.arrays import Array
from tools.arguments import existing, parser_of, target
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
    size=(720, 480),
    smear_px=(8.0, 20.0),
    short_share=0.0,
    still_share=0.0,
    mover_share=1.0,
    rest_share=0.0,
    focus_share=0.0,
)
QUALITY = 92


def moving_camera(photos: Path | None) -> Array:
    """Return the radiance (H, W, 3) of a scene that stands still."""
    options = replace(test_options(photos, (960, 540)), smear_px=SMEAR_PX, mover_share=0.0)
    return render(SEED, options).linear


def mover(photos: Path) -> Array:
    """Return the radiance (H, W, 3) of one of a folder's photographs and of a piece of another before it."""
    surfaces = [read_photograph(path) for path in sorted(photos.rglob("*.png"))]
    return shake(np.random.default_rng(MOVER_SEED), surfaces, MOVER).linear


def main() -> None:
    """Render, photograph, write."""
    parser = parser_of(__doc__)
    parser.add_argument("target", type=target)
    parser.add_argument("--photos", type=existing, help="folder of the Kodak photographs")
    parser.add_argument("--mover", action="store_true", help="the sample in which something moves")
    arguments = parser.parse_args()
    if arguments.mover and arguments.photos is None:
        parser.error("--mover needs --photos")
    linear = mover(arguments.photos) if arguments.mover else moving_camera(arguments.photos)
    sensor = (
        SensorOptions(jpeg_share=0.0, defocus_share=0.0) if arguments.mover else SensorOptions(jpeg_share=0.0)
    )
    picture = photograph(np.random.default_rng(SENSOR_SEED), linear, sensor)
    cv2.imwrite(str(arguments.target), picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, QUALITY])


if __name__ == "__main__":
    main()
