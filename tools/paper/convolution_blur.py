"""Blur by convolution against blur by averaging: what a convolution gets wrong where surfaces hide others.

    python -m tools.paper.convolution_blur --photos KODAK --out tools/results/figures/convolution.png

A convolution spreads the sharp frame of mid exposure along every pixel's own smear; the renderer averages
what is seen at every instant. They agree inside of surfaces. At the border of a near one, which hides and
uncovers what is behind it, the convolution keeps a sharp edge, or draws on what was never seen there.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import AnyArray
from tools.arguments import existing, parser_of, target
from tools.datasets.exposure import coded
from tools.rendering.canvas import Canvas, paint
from tools.rendering.exposure import Exposure, pixel_grid
from tools.rendering.failure_scenes import cards, path_of
from tools.rendering.render import compose, mean_frame, scaled_exposure
from tools.rendering.scene import sample_intrinsics
from tools.rendering.textures import photographs
from tools.rendering.truth import top_layer
from tools.reports.figure_style import new_figure, save, show_picture, style

if TYPE_CHECKING:
    from matplotlib.figure import Figure


SEED, LENGTH_PX, SIZE = 11, 24.0, (640, 480)
BORDER_PX = 8
"""Reach of what counts as the border of a surface."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Blurs:
    """Linear pictures (H, W, 3): the sharp mid frame and both blurs; `border` (H, W) about edges."""

    sharp: AnyArray
    averaged: AnyArray
    convolved: AnyArray
    border: NDArray[np.bool_]

    def error(self, where: NDArray[np.bool_]) -> float:
        """Return the mean absolute difference of both blurs, of the 255 levels of a coded photograph."""
        difference = np.abs(coded(self.averaged).astype(float) - coded(self.convolved).astype(float))
        return float(difference[where].mean())

    def figures(self) -> dict[str, float]:
        """Return what is stored: both errors and the share of the image that counts as borders."""
        return {
            "difference_at_borders": self.error(self.border),
            "difference_inside": self.error(~self.border),
            "border_share": float(self.border.mean()),
        }


def convolve(sharp: AnyArray, displacement: AnyArray, count: int) -> AnyArray:
    """Return a sharp frame (H, W, 3) blurred along every pixel's smear (H, W, 2), `count` samples of it."""
    pixels = pixel_grid((sharp.shape[1], sharp.shape[0]))
    total = np.zeros_like(sharp)
    for share in (np.arange(count) + 0.5) / count - 0.5:
        at = pixels + np.float32(share) * displacement
        total += cv2.remap(sharp, at[..., 0], at[..., 1], cv2.INTER_LINEAR, None, cv2.BORDER_REPLICATE)
    return np.asarray(total / np.float32(count))


def blurs(
    seed: int, photos: Path | None, size: tuple[int, int] = SIZE, length_px: float = LENGTH_PX
) -> Blurs:
    """Return a rendered scene of cards before a background, blurred both ways."""
    rng = np.random.default_rng([seed, 11])
    K = sample_intrinsics(rng, size)
    layers = cards(rng, photographs("test", photos), K, size)
    exposure = scaled_exposure(
        Exposure(camera=path_of(rng, ("translation",))[0], K=K, size=size), layers, length_px
    )
    fields = [exposure.inverse_displacements(layer) for layer in layers]
    canvases = [paint(rng, layer, K, size, length_px * 3, 1.5) for layer in layers]
    sharp = compose(canvases, [np.zeros_like(f[0]) for f in fields], size)
    index = top_layer(canvases, pixel_grid(size))
    displacement = smears_of(exposure, canvases, index)
    count = int(np.clip(np.linalg.norm(displacement, axis=-1).max(), 15, 200))
    reach = np.ones((2 * BORDER_PX + 1, 2 * BORDER_PX + 1), np.uint8)
    labels = index.astype(np.uint8)
    return Blurs(
        sharp=sharp,
        averaged=mean_frame(canvases, fields, size),
        convolved=convolve(sharp, displacement, count),
        border=cv2.dilate(labels, reach) != cv2.erode(labels, reach),
    )


def smears_of(exposure: Exposure, canvases: list[Canvas], index: AnyArray) -> AnyArray:
    """Return the smear (H, W, 2) of what is seen at every pixel at mid exposure, float32."""
    pixels = pixel_grid(exposure.size)
    displacement = np.zeros(pixels.shape, np.float32)
    for k, canvas in enumerate(canvases):
        seen = index == k
        start, end = exposure.ends(pixels.astype(float), canvas.layer)
        displacement[seen] = (end - start)[seen]
    return displacement


def figure_of(found: Blurs) -> Figure:
    """Return a figure of the sharp frame, both blurs and their difference."""
    figure = new_figure(10, 7.9)
    panels = figure.subplots(2, 2).ravel()
    show_picture(panels[0], coded(found.sharp), "sharp frame of mid exposure")
    show_picture(panels[1], coded(found.averaged), "averaged over the exposure: what a camera sees")
    show_picture(panels[2], coded(found.convolved), "sharp frame convolved along each pixel's smear")
    levels = np.abs(coded(found.averaged).astype(float) - coded(found.convolved)).mean(axis=2)
    show_picture(panels[3], levels, "difference, of 255 levels")
    panels[3].images[0].set(cmap="cividis", clim=(0, 60))
    figure.colorbar(panels[3].images[0], ax=panels[3], extend="max", shrink=0.8)
    return figure


def main() -> None:
    """Command line."""
    parser = parser_of(__doc__)
    parser.add_argument("--photos", type=existing, help="folder of photographs; its held-out part is used")
    parser.add_argument(
        "--out", type=target, required=True, help="PNG to write; OUT.json is written beside it"
    )
    arguments = parser.parse_args()
    found = blurs(SEED, arguments.photos)
    with style():
        save(figure_of(found), arguments.out)
    arguments.out.with_suffix(".json").write_text(json.dumps(found.figures(), indent=1) + "\n")
    print(found.figures())


if __name__ == "__main__":
    main()
