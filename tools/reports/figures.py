"""Draw the figures of a paper about blur2view from the rendered test split and the shipped network.

    python -m tools.datasets.testset render/test --scenes 60 --photos KODAK
    python -m tools.reports.figures render/test --photos KODAK --out tools/results/figures

writes PNG files of at most 300 kB each: ``sparsification`` (what sigma is worth), ``cumulative`` (SErrMin of
several F's), ``smears``, ``epipolar_lines`` and ``segmentation`` (a good, a middling and a bad image, chosen
by rank) and ``failure_*`` (what is said of many movers, one plane and pure rotation).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import blur2view
from tools.arguments import existing, parser_of, target
from tools.datasets.testset import read_test_set
from tools.rendering.failure_scenes import KINDS
from tools.reports.figure_cases import Case, cases
from tools.reports.figure_curves import cumulative, sparsification
from tools.reports.figure_failures import failure_figures
from tools.reports.figure_panels import epipolar_panels, smear_panels
from tools.reports.figure_segmentation import segmentation_panels
from tools.reports.figure_style import save, style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

OF_CASES: dict[str, Callable[[Sequence[Case]], Figure | None]] = {
    "sparsification": sparsification,
    "cumulative": cumulative,
    "smears": smear_panels,
    "epipolar_lines": epipolar_panels,
    "segmentation": segmentation_panels,
}
"""Figures of the test split."""
FAILURES = "failures"


def write(scenes: Path, out: Path, network: blur2view.SmearNetwork, photos: Path | None, only: str) -> None:
    """Draw all figures, or only the one of a name, and print the files."""
    wanted = [name for name in OF_CASES if only in ("", name)]
    found = list(cases(read_test_set(scenes), network)) if wanted else []
    if wanted and not found:
        raise SystemExit(f"no scenes in {scenes}: run python -m tools.datasets.testset {scenes}")
    with style():
        for name in wanted:
            figure = OF_CASES[name](found)
            print(save(figure, out / f"{name}.png") if figure else f"no scene for {name}", flush=True)
        if only in ("", FAILURES):
            for kind, figure in zip(KINDS, failure_figures(network, photos), strict=True):
                print(save(figure, out / f"failure_{kind.replace(' ', '_')}.png"), flush=True)


def main() -> None:
    """Command line."""
    parser = parser_of(__doc__)
    parser.add_argument("scenes", type=existing, help="folder written by tools.datasets.testset")
    parser.add_argument(
        "--out", type=target, default=Path("tools/results/figures"), help="(default: %(default)s)"
    )
    parser.add_argument(
        "--photos", type=existing, help="folder of texture photographs, for the failure cases"
    )
    parser.add_argument("--model", help="ONNX file (default: the shipped network)")
    parser.add_argument("--only", default="", choices=[*OF_CASES, FAILURES], help="draw one of them")
    arguments = parser.parse_args()
    network = blur2view.SmearNetwork(arguments.model)
    write(arguments.scenes, arguments.out, network, arguments.photos, arguments.only)


if __name__ == "__main__":
    main()
