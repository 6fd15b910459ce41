"""Photographs with movers, or without, for `tools.evaluation.segmentation`: rendered scenes, or layers.

``python -m tools.datasets.mover_scenes render/movers --scenes 12`` writes ``NNNN.png`` and ``NNNN.npz`` as
`tools.datasets.testset` does, from other seeds, with 1 to 40 % of every picture moving: few scenes of the
test split hold movers. ``--kind still`` renders scenes in which nothing moves. The other kinds are those
of `tools.rendering.layer_scenes` and need ``--photos``.
"""

from itertools import count
from pathlib import Path
from typing import Literal

import numpy as np

from tools.command import Existing, run
from tools.datasets.testset import in_range, write_photographed, write_truth
from tools.rendering.layer_scenes import KINDS, Sources, layer_scene, silhouettes
from tools.rendering.render import Rendering, RenderOptions, render
from tools.rendering.sensor import processed
from tools.rendering.textures import load_photos

FIRST_SEED = {"movers": 6_000_000, "still": 9_000_000, "layers": 11_000_000}
MIN_SHARE, MAX_SHARE = 0.01, 0.4  # of the picture, that moves


def suits(scene: Rendering, options: RenderOptions) -> bool:
    """Return whether movers and smears have the wanted sizes; true if no movers are wanted."""
    share = float((scene.valid & ~scene.static).mean())
    return not options.mover_share or (MIN_SHARE <= share <= MAX_SHARE and in_range(scene, options.smear_px))


def write_layers(out: Path, scenes: int, photos: Path, kind: str) -> None:
    """Write pictures of layers of a kind."""
    sources, size = Sources(photographs=load_photos([photos]), things=silhouettes()), (640, 480)
    for index in range(scenes):
        rng = np.random.default_rng([FIRST_SEED["layers"], KINDS.index(kind), index])
        scene = layer_scene(rng, sources, size, kind=kind, longest_px=float(rng.choice([16, 40, 80])))
        picture = np.clip(processed(rng, scene.linear)[0], 0, 255)
        static = scene.moving <= 0.5
        truth = {"displacement": scene.displacement, "valid": np.ones_like(static), "static": static}
        unknown = {"K": np.eye(3), "R": np.eye(3), "t": np.zeros(3), "F": None, "kind": kind}
        write_truth(out / f"{index:04d}.npz", picture.astype(np.uint8), **truth, **unknown)


def main(
    out: Path,
    *,
    scenes: int = 12,
    kind: Literal[
        "movers", "still", "camera", "deep", "follow", "cross", "rest", "unmoved", "shallow"
    ] = "movers",
    photos: Existing | None = None,
) -> None:
    """Write scenes of a kind; layers are made of the photographs in a folder."""
    if (kind in KINDS) != (photos is not None):
        raise SystemExit("--photos belongs to kinds of layers, and they need it")
    out.mkdir(parents=True, exist_ok=True)
    if any(out.iterdir()):
        raise SystemExit(f"{out} is not empty")
    if photos is not None:
        write_layers(out, scenes, photos, kind)
        return
    options = RenderOptions(mover_share=float(kind == "movers"))
    drawn = ((seed, render(seed, options)) for seed in count(FIRST_SEED[kind]))
    suiting = ((seed, scene) for seed, scene in drawn if suits(scene, options))
    for number, (seed, scene) in zip(range(scenes), suiting, strict=False):
        write_photographed(out / f"{number:04d}.npz", scene, np.random.default_rng([seed, 2]))


if __name__ == "__main__":
    run(main)
