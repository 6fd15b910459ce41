"""Count what is said of photographs that leave F open: the supplement's failure cases.

    python -m tools.failure_cases --photos KODAK --out tools/results/paper_failures.json

renders ten photographs of each kind of :mod:`tools.failure_scenes` (about five minutes of two cores) and
counts the verdicts of `blur2view.estimate`. `tools.figures --only failures` shows some of them.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

import blur2view
from blur2view.geometry import TwoViewGeometry
from tools.failure_scenes import KINDS, FailureScene, failure_scene

SEEDS = 10


def verdict(geometry: TwoViewGeometry) -> str:
    """Name the verdict: the configuration, and whether F comes with a homography (parallax not proven)."""
    if geometry.F is not None and geometry.H is not None:
        return f"{geometry.config.name}, parallax not proven"
    return geometry.config.name


def correct(kind: str, geometry: TwoViewGeometry) -> bool:
    """Whether the verdict does not claim more than there is to see.

    Of one plane and of a pure rotation: no F, or one whose parallax is called not proven. Of many movers:
    several motions, or no F.
    """
    if geometry.F is None:
        return True
    return geometry.config.name == "MULTIPLE" if kind == "many movers" else geometry.H is not None


def counts(scenes: Iterable[FailureScene], network: blur2view.SmearNetwork) -> dict[str, object]:
    """Count the verdicts on scenes of one kind."""
    names: Counter[str] = Counter()
    right = 0
    for scene in scenes:
        image = np.asarray(scene.photograph, np.float32) / np.float32(255)
        geometry = blur2view.estimate(image, network=network).geometry
        names[verdict(geometry)] += 1
        right += correct(scene.kind, geometry)
    return {"verdicts": dict(names.most_common()), "not misled": right, "images": names.total()}


def markdown(document: dict[str, dict[str, object]]) -> list[str]:
    """Write the counts as lines of Markdown."""
    lines = ["| scenes | images | claim no more than there is to see | verdicts |", "|---|---|---|---|"]
    for kind, row in document.items():
        verdicts = row["verdicts"]
        assert isinstance(verdicts, dict)
        said = "; ".join(f"{count} {name}" for name, count in verdicts.items())
        lines.append(f"| {kind} | {row['images']} | {row['not misled']} | {said} |")
    return lines


def study(network: blur2view.SmearNetwork, photos: Path | None, seeds: Sequence[int]) -> dict[str, object]:
    """Count all kinds; give what is stored."""
    kinds = {kind: counts((failure_scene(kind, s, photos) for s in seeds), network) for kind in KINDS}
    return {"model_id": network.info.model_id, "kinds": kinds}


def main() -> None:
    """Command line."""
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument("--photos", type=Path, help="folder of photographs; its held-out part is used")
    parser.add_argument("--seeds", type=int, default=SEEDS)
    parser.add_argument("--model", help="ONNX file; the shipped one by default")
    parser.add_argument("--out", type=Path, required=True, help="JSON file to write")
    arguments = parser.parse_args()
    network = blur2view.SmearNetwork(arguments.model)
    document = study(network, arguments.photos, range(arguments.seeds))
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    arguments.out.write_text(json.dumps(document, indent=1) + "\n")
    kinds = document["kinds"]
    assert isinstance(kinds, dict)
    print("\n".join(markdown(kinds)))


if __name__ == "__main__":
    main()
