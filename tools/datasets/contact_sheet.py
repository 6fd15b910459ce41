"""Show rendered scenes beside their truth, so that a person can judge them.

``python -m tools.datasets.contact_sheet --out sheet.png --scenes 12`` writes one row a seed: the blurred
picture, its smears (hue = orientation, brightness = length), and labels (grey static, pink moving, dark where
an end is hidden).
"""

from __future__ import annotations

import cv2
import numpy as np

from blur2view.arrays import AnyArray
from tools.arguments import parser_of, target
from tools.datasets.shards import add_scene_arguments, scene_arguments
from tools.rendering.render import Rendering, RenderOptions, render


def contact_sheet(seeds: range, options: RenderOptions) -> AnyArray:
    """Return rows of pictures, uint8 BGR (len(seeds) H, 3 W, 3): picture, smears, labels."""
    rows = []
    for seed in seeds:
        rendering = render(seed, options)
        row = scene_row(rendering)
        median_px = np.median(np.linalg.norm(rendering.displacement, axis=-1))
        text = f"seed {seed} {rendering.kind} {median_px:.1f} px"
        cv2.putText(row, text, (6, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (255, 255, 255), 1, cv2.LINE_AA)
        rows.append(row)
    return np.concatenate(rows, 0)


def scene_row(rendering: Rendering) -> AnyArray:
    """Return one row, uint8 BGR (H, 3 W, 3)."""
    height, width = rendering.linear.shape[:2]
    image = (np.clip(rendering.linear, 0, 1) ** (1 / 2.2) * 255).astype(np.uint8)[..., ::-1]
    truth = [smear_picture(rendering.displacement), label_picture(rendering)]
    large = [cv2.resize(p, (width, height), interpolation=cv2.INTER_NEAREST) for p in truth]
    return np.concatenate([image, *large], 1)


def smear_picture(displacement: AnyArray) -> AnyArray:
    """Return a field's colours (uint8 BGR): hue = orientation, brightness = length up to 40 px."""
    hue = (np.degrees(np.arctan2(displacement[..., 1], displacement[..., 0])) % 180).astype(np.uint8)
    length = np.clip(np.linalg.norm(displacement, axis=-1) / 40, 0, 1) ** 0.5 * 255
    hsv = np.stack([hue, np.full_like(hue, 255), length.astype(np.uint8)], -1)
    return np.asarray(cv2.cvtColor(hsv, cv2.COLOR_HSV2BGR))


def label_picture(rendering: Rendering) -> AnyArray:
    """Return static pixels grey, moving ones pink, darker where an end is hidden (uint8 BGR)."""
    picture = np.where(rendering.static[..., None], (170, 170, 170), (180, 80, 255))
    return np.asarray(np.where(rendering.valid[..., None], picture, picture // 4)).astype(np.uint8)


def main() -> None:
    """Write a contact sheet."""
    parser = parser_of(__doc__)
    parser.add_argument("--out", type=target, required=True, help="the sheet's PNG file")
    add_scene_arguments(parser)
    arguments = parser.parse_args()
    if not cv2.imwrite(str(arguments.out), contact_sheet(*scene_arguments(arguments))):
        raise SystemExit(f"cannot write {arguments.out}: does its folder exist?")


if __name__ == "__main__":
    main()
