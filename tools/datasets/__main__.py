"""Turn a dataset of the paper into the formats of this repository.

    python -m tools.datasets --kind monkaa ~/SceneFlow/Monkaa --out render/monkaa --every 20 --most 60
    python -m tools.evaluation.evaluate render/monkaa --out monkaa
    python -m tools.datasets --kind driving ~/SceneFlow/Driving --out render/driving_train --train --most 2000

The first writes what `testset` writes (the blurred photograph, its sharp ends and the truth), the
last shards as `shards`. ``help('tools.datasets')`` has layouts and licences. All that moves
counts as static, as in the paper: the datasets do not say what moves by itself.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path

from blur2view.errors import Blur2ViewError
from tools.datasets.convert import write_shards, write_test_scenes
from tools.datasets.exposure import Exposure, Reader
from tools.datasets.sceneflow import PASSES, SIDES, SceneFlow
from tools.datasets.videos import RBI, GoProPairs, GoProSharp

KINDS = ("monkaa", "driving", "gopro-sharp", "gopro", "rbi")


def reader(kind: str, root: Path, side: str, render_pass: str, split: str) -> Reader:
    """Return a reader of a dataset."""
    readers: dict[str, Callable[[], Reader]] = {
        "monkaa": lambda: SceneFlow(root, side, render_pass),
        "driving": lambda: SceneFlow(root, side, render_pass),
        "gopro-sharp": lambda: GoProSharp(root, split),
        "gopro": lambda: GoProPairs(root, split),
        "rbi": lambda: RBI(root),
    }
    return readers[kind]()


def source(arguments: argparse.Namespace) -> str:
    """Return what exposures are of, beside their own names."""
    sceneflow = arguments.kind in ("monkaa", "driving")
    return f"{arguments.kind} {arguments.render_pass}" if sceneflow else str(arguments.kind)


def thinned(exposures: Reader, every: int, most: int) -> Iterator[Exposure]:
    """Yield every so many exposures, and at most so many."""
    return (read() for read in islice(exposures.unread(), 0, every * most, every))


def main() -> None:
    """Command line."""
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(prog="tools.datasets", description=__doc__, formatter_class=raw)
    parser.add_argument("root", type=Path, help="where the dataset was unpacked")
    parser.add_argument("--kind", choices=KINDS, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--train", action="store_true", help="shards for training, not a test split")
    parser.add_argument("--side", choices=list(SIDES), default="left", help="SceneFlow (default: left)")
    parser.add_argument("--pass", dest="render_pass", choices=PASSES, default="clean", help="SceneFlow")
    parser.add_argument("--split", default="test", help="GoPro (default: test)")
    parser.add_argument("--every", type=int, default=1, help="take every n-th exposure (default 1)")
    parser.add_argument("--most", type=int, default=1_000_000, help="at most so many")
    arguments = parser.parse_args()
    try:
        found = reader(arguments.kind, arguments.root, arguments.side, arguments.render_pass, arguments.split)
        exposures = thinned(found, arguments.every, arguments.most)
        if arguments.train:
            written = write_shards(exposures, arguments.out)
        else:
            written = write_test_scenes(exposures, arguments.out, source(arguments))
    except Blur2ViewError as error:
        raise SystemExit(str(error)) from None
    print(f"{written} exposures in {arguments.out}")


if __name__ == "__main__":
    main()
