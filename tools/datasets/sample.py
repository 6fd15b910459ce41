"""Render the photograph that ships as ``models/sample.jpg``.

``python -m tools.datasets.sample models/sample.jpg --photos KODAK`` gives the same bytes again.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from blur2view.geometry.epipolar import epipoles
from tools.arguments import existing, parser_of, target
from tools.datasets.testset import test_options
from tools.rendering.render import render
from tools.rendering.sensor import SensorOptions, photograph

SEED = 2_000_045
"""Walls, a ground and cards, seen by a camera that moves forward."""
SENSOR_SEED = 4
SMEAR_PX = (10.0, 14.0)
"""Median smear over all surfaces, hidden ones too; that of the visible pixels is 10.2 px."""


def main() -> None:
    """Render, photograph, write."""
    parser = parser_of(__doc__)
    parser.add_argument("target", type=target)
    parser.add_argument("--photos", type=existing, help="folder of the Kodak photographs")
    arguments = parser.parse_args()
    options = replace(test_options(arguments.photos, (960, 540)), smear_px=SMEAR_PX, mover_share=0.0)
    scene = render(SEED, options)
    picture = photograph(np.random.default_rng(SENSOR_SEED), scene.linear, SensorOptions(jpeg_share=0.0))
    cv2.imwrite(str(arguments.target), picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 92])
    if scene.F is not None:
        x, y, w = epipoles(scene.F)[0]
        print(f"{arguments.target}: epipole of the true F at ({x / w:.0f}, {y / w:.0f})")


if __name__ == "__main__":
    main()
