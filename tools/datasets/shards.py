"""Write rendered scenes for training, in shards.

``python -m tools.datasets.shards render/train --scenes 6000 --photos KODAK`` renders seeds 0 to 5999 in
all processes the machine has; run again, it goes on where it stopped.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Self

import numpy as np

from blur2view.arrays import AnyArray
from blur2view.errors import Blur2ViewError
from tools.arguments import scene_parser
from tools.processes import single_threaded_pool
from tools.rendering.render import RenderOptions, render

SHARD = 50  # scenes in one file
WHITE = 4.0  # largest radiance that is stored


@dataclass(frozen=True, kw_only=True)
class Scenes:
    """Rendered scenes in memory, compactly.

    ``linear`` (N, H, W, 3) is the uint16 code of the radiance (:func:`decode_linear`), ``displacement``
    (N, H/4, W/4, 2) float16 pixels, not finite where they overflow, ``labels`` uint8: 1 valid + 2 static.
    """

    linear: AnyArray
    displacement: AnyArray
    labels: AnyArray

    def __len__(self) -> int:
        return len(self.labels)

    def save(self, path: Path) -> None:
        """Write a shard; a reader sees all of it or nothing."""
        temporary = path.with_suffix(".tmp.npz")
        np.savez(temporary, linear=self.linear, displacement=self.displacement, labels=self.labels)
        temporary.replace(path)

    @classmethod
    def join(cls, parts: Iterable[Self]) -> Self:
        """Return scenes of one size in one."""
        columns = zip(*((p.linear, p.displacement, p.labels) for p in parts), strict=True)
        linear, displacement, labels = (np.concatenate(column) for column in columns)
        return cls(linear=linear, displacement=displacement, labels=labels)


def encode_linear(linear: AnyArray) -> AnyArray:
    """Return radiance (0 to 4) as uint16 of its square root: fine in the dark, room for highlights."""
    return np.asarray(np.sqrt(np.clip(linear, 0, WHITE) / WHITE) * 65535 + 0.5).astype(np.uint16)


def decode_linear(coded: AnyArray) -> AnyArray:
    """Return the inverse of :func:`encode_linear`: float32."""
    root = coded.astype(np.float32) * np.float32(np.sqrt(WHITE) / 65535)
    return np.asarray(root * root)


def training_record(seed: int, options: RenderOptions) -> Scenes:
    """Return one scene rendered for training."""
    rendering = render(seed, options)
    labels = rendering.valid.astype(np.uint8) + 2 * rendering.static.astype(np.uint8)
    displacement = rendering.displacement.astype(np.float16)
    linear = encode_linear(rendering.linear)
    return Scenes(linear=linear[None], displacement=displacement[None], labels=labels[None])


def load_shards(folder: Path) -> Scenes:
    """Return all scenes of a folder; Blur2ViewError if it holds none."""
    paths = require_shards(folder)
    merged: dict[str, AnyArray] = {}
    counts = [len(np.load(path)["labels"]) for path in paths]  # pictures are not read yet
    end = 0
    for path, count in zip(paths, counts, strict=True):
        end += count
        with np.load(path) as shard:
            for key in shard.files:  # copied at once: joining all shards at the end takes twice the memory
                array = shard[key]
                if key not in merged:
                    merged[key] = np.empty((sum(counts), *array.shape[1:]), array.dtype)
                merged[key][end - count : end] = array
    return Scenes(**merged)


def require_shards(folder: Path) -> list[Path]:
    """Return the finished shards of a folder; Blur2ViewError if there are none."""
    paths = sorted(p for p in folder.glob("*.npz") if not p.name.endswith(".tmp.npz"))
    if not paths:
        raise Blur2ViewError(f"no scenes in {folder}: run python -m tools.datasets.shards {folder}")
    return paths


def write_shards(out: Path, seeds: range, options: RenderOptions, jobs: int, shard: int) -> Iterator[Path]:
    """Render `seeds`, rounded up to whole files of `shard` scenes; yield each file when it is written.

    Finished files are kept and not yielded, so a stopped run resumes.
    """
    out.mkdir(parents=True, exist_ok=True)
    record = partial(training_record, options=options)
    with single_threaded_pool(jobs) as pool:
        for start in range(seeds.start, seeds.stop, shard):
            path = out / f"{options.split}_{start:08d}.npz"
            if not path.exists():
                Scenes.join(pool.map(record, range(start, start + shard), chunksize=2)).save(path)
                yield path


def main() -> None:
    """Write a dataset."""
    arguments = scene_parser(__doc__, 12, RenderOptions.size).parse_args()
    options = RenderOptions(size=tuple(arguments.size), photos=arguments.photos)
    for path in write_shards(arguments.out, range(arguments.scenes), options, arguments.jobs, SHARD):
        print(path, flush=True)


if __name__ == "__main__":
    main()
