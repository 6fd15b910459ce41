"""What the motion segmentation network is trained on: photographs, what is known of their smears, what moves.

``python -m tools.training.motion_data render/train render/motion.npz`` photographs rendered scenes, estimates
smears and the camera's motion with the shipped network as anybody would, and stores what
:class:`MotionExamples` holds: all scenes with something that moves and a quarter of the others. 12 minutes of
one core for 5150 scenes.
"""

from __future__ import annotations

import argparse
import multiprocessing
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass, fields
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blur2view.errors import Blur2ViewError
from blur2view.networks.smear_network import SmearNetwork
from blur2view.pipeline import estimate
from blur2view.segmentation.features import motion_features
from blur2view.segmentation.score import motion_score
from tools.arguments import existing, target
from tools.datasets.shards import decode_linear, require_shards, start_worker
from tools.rendering.sensor import photograph

Array = NDArray[Any]

LEAST_SHARE = 0.005  # of a picture that moves, for it to be kept for sure
KEPT_WITHOUT = 0.25  # of the others
VALID, STATIC = 1, 2  # bits of the labels


@dataclass(frozen=True, kw_only=True, eq=False)
class MotionExamples:
    """N photographs of one size.

    Parameters
    ----------
    image : ndarray of shape (N, H, W, 3)
        uint8 RGB.
    features : ndarray of shape (N, C, H/4, W/4)
        float16, see :func:`blur2view.segmentation.features.motion_features`.
    labels : ndarray of shape (N, H/4, W/4)
        uint8: 1 smear known + 2 static.
    """

    image: Array
    features: Array
    labels: Array

    def __len__(self) -> int:
        """Count the photographs."""
        return len(self.labels)

    @property
    def moving(self) -> NDArray[np.bool_]:
        """What moves by itself, (N, h, w)."""
        return np.asarray(self.labels & STATIC == 0)

    def save(self, path: Path) -> None:
        """Write a file; a reader sees all of it or nothing."""
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary = path.with_suffix(".tmp.npz")
        np.savez(temporary, image=self.image, features=self.features, labels=self.labels)
        temporary.replace(path)

    @classmethod
    def load(cls, path: Path) -> MotionExamples:
        """Read a file; Blur2ViewError if there is none, or it is none."""
        try:
            with np.load(path) as stored:
                return cls(**{f.name: stored[f.name] for f in fields(cls)})
        except (OSError, EOFError, KeyError, TypeError, ValueError, zipfile.BadZipFile):
            remedy = f"run python -m tools.training.motion_data SHARDS {path}"
            raise Blur2ViewError(f"no examples in {path}: {remedy}") from None


def examples_of(shard: Path, model: Path | None = None) -> list[tuple[Array, Array, Array]]:
    """Photograph and estimate the scenes of one shard that are kept: images, features, labels."""
    network, found = SmearNetwork(model, threads=1), []
    with np.load(shard) as stored:
        linear, labels = stored["linear"], stored["labels"]
    for k, label in enumerate(labels):
        rng = np.random.default_rng([int(shard.stem.split("_")[1]), k, 3])
        if (label & STATIC == 0).mean() < LEAST_SHARE and rng.random() >= KEPT_WITHOUT:
            continue
        image = photograph(rng, decode_linear(linear[k]))
        one = estimate(np.asarray(image / 255, np.float32), network=network)
        found.append((image, motion_features(one, motion_score(one)).astype(np.float16), label))
    return found


def make(folder: Path, processes: int, model: Path | None = None) -> MotionExamples:
    """Make the examples of all shards of a folder, in their order; Blur2ViewError if there are none.

    Smears are those of the network ``model``, by default the shipped one.
    """
    shards = require_shards(folder)
    context = multiprocessing.get_context("spawn")
    with context.Pool(processes, start_worker) as pool:
        parts = list(told(pool.imap(partial(examples_of, model=model), shards), len(shards)))
    if not any(parts):
        raise Blur2ViewError(
            f"nothing moves in the scenes of {folder}: render more with python -m tools.datasets.shards"
        )
    image, features, labels = (np.stack(column) for column in zip(*sum(parts, []), strict=True))
    return MotionExamples(image=image, features=features, labels=labels)


def told(parts: Iterator[Any], count: int) -> Iterator[Any]:
    """Pass parts on, saying how many there were."""
    for k, part in enumerate(parts, 1):
        print(f"shard {k} of {count}", flush=True)
        yield part


def main() -> None:
    """Command line."""
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument("shards", type=existing, help="folder that tools.datasets.shards wrote")
    parser.add_argument("out", type=target)
    parser.add_argument("--processes", type=int, default=multiprocessing.cpu_count())
    parser.add_argument("--model", type=existing, help="smear network (default: the shipped one)")
    arguments = parser.parse_args()
    try:
        make(arguments.shards, arguments.processes, arguments.model).save(arguments.out)
    except (Blur2ViewError, OSError) as error:
        raise SystemExit(str(error)) from None


if __name__ == "__main__":
    main()
