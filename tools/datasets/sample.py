"""Make the photograph of a moving camera that ships in ``models/``, the same bytes again.

``python -m tools.datasets.sample models/sample.jpg --photos KODAK``. ``models/sample_mover.jpg``, of which a
part moved otherwise, is by an earlier generator (``git show f5f66756:tools/datasets/sample.py``).
"""

from dataclasses import replace

import cv2
import numpy as np

from tools.arguments import Existing, Target, run
from tools.datasets.testset import test_options
from tools.rendering.render import render
from tools.rendering.sensor import SensorOptions, photograph

SEED = 2_000_048  # cards at several depths, seen by a camera that moves forward
SENSOR_SEED = 4
SMEAR_PX = (10.0, 14.0)
"""Median smear over all surfaces, hidden ones too; those of the visible pixels are shorter."""
QUALITY = 92


def main(target: Target, *, photos: Existing | None = None) -> None:
    """Write the sample of a moving camera, of the Kodak photographs."""
    options = replace(test_options(photos, (960, 540)), smear_px=SMEAR_PX, mover_share=0.0)
    linear, lens = render(SEED, options).linear, SensorOptions(jpeg_share=0.0)
    picture = photograph(np.random.default_rng(SENSOR_SEED), linear, lens)
    cv2.imwrite(str(target), picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, QUALITY])


if __name__ == "__main__":
    run(main)
