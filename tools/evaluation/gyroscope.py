"""Smears of real photographs against measured ones.

``python -m tools.evaluation.gyroscope FOLDER`` reads pairs of a photograph and an ``.npz`` of the same name
with displacements up to sign: ``smear`` (h, w, 2) at pixels (4 j + 2, 4 i + 2), as a gyroscope measured them
(DeepGyro, Mustaniemi et al., WACV 2019), or ``flow`` (h, w, 2) at pixels (4 j + 1.5, 4 i + 1.5) and where it
is ``valid`` (h, w). It prints, per photograph, median length, direction errors over all and over the surer
half, and predicted over true length; and errors of all photographs by true length. No photograph ships.
"""

from collections.abc import Mapping
from dataclasses import astuple, dataclass
from pathlib import Path

import numpy as np

import blur2view
from blur2view.arrays import AnyArray
from blur2view.smears.field import SmearField
from tools.evaluation.even_blur import photograph_parser, photographs_of
from tools.evaluation.smear_figures import by_octave, octave_table
from tools.metrics import DIRECTION_MIN_PX
from tools.pages import table


@dataclass(frozen=True, kw_only=True)
class GyroscopeFigures:
    """Medians over one photograph; degrees, the length ratio, and the median deviation of its logarithm."""

    length_px: float
    direction_deg: float
    direction_deg_top50: float
    signed_deg_top50: float
    length_ratio: float
    length_spread: float


def pairs_of(field: SmearField, truth: Mapping[str, AnyArray]) -> tuple[AnyArray, AnyArray, AnyArray]:
    """Return smears found (N, 2), measured ones (N, 2), and sigmas (N,), where something was measured."""
    first, name = (2, "smear") if "smear" in truth else (1, "flow")
    measured = truth[name].astype(float)
    rows, columns = measured.shape[:2]
    read, sigma = (a[first::4, first::4][:rows, :columns] for a in (field.displacement, field.sigma_rad))
    measured = measured[: read.shape[0], : read.shape[1]]
    known = np.hypot(measured[..., 0], measured[..., 1]) >= (DIRECTION_MIN_PX if name == "flow" else 0)
    if "valid" in truth:
        known &= truth["valid"][: read.shape[0], : read.shape[1]]
    return read[known].astype(float), measured[known], sigma[known]


def figures_of(read: AnyArray, true: AnyArray, sigma: AnyArray) -> GyroscopeFigures:
    """Return how well smears (N, 2) agree with measured ones (N, 2)."""
    found, measured = (d[..., 0] + 1j * d[..., 1] for d in (read, true))
    error_deg = np.degrees(np.angle(found**2 * np.conj(measured**2))) / 2
    ratio = np.log(np.maximum(abs(found), 1e-2) / np.maximum(abs(measured), 1e-2))
    sure = sigma <= np.median(sigma)
    return GyroscopeFigures(
        length_px=float(np.median(abs(measured))),
        direction_deg=float(np.median(abs(error_deg))),
        direction_deg_top50=float(np.median(abs(error_deg[sure]))),
        signed_deg_top50=float(np.median(error_deg[sure])),
        length_ratio=float(np.exp(np.median(ratio))),
        length_spread=float(np.median(abs(ratio - np.median(ratio)))),
    )


def evaluate(
    folders: list[Path], network: blur2view.SmearNetwork
) -> dict[str, tuple[AnyArray, AnyArray, AnyArray]]:
    """Return `pairs_of` every photograph of folders that has a measurement, by name."""
    pairs = {}
    for path in photographs_of(folders):
        truth = path.with_suffix(".npz")
        if truth.exists():
            with np.load(truth) as file:
                field = network.predict(blur2view.read_image(path)).at_pixels()
                pairs[path.stem] = pairs_of(field, dict(file))
    return pairs


def page(figures: dict[str, GyroscopeFigures]) -> list[str]:
    """Return figures as lines of Markdown, their medians last (of magnitudes, as signs cancel)."""
    head = "photograph | px | direction, deg | certain half | signed | length ratio | spread of its log"
    rows = {name: astuple(row) for name, row in figures.items()}
    rows["median"] = tuple(np.median(np.abs(list(rows.values())), axis=0))
    cells = ((name, f"{px:.1f}", *(f"{x:.2f}" for x in rest)) for name, (px, *rest) in rows.items())
    return table(head, list(cells))


def main() -> None:
    """Command line."""
    arguments = photograph_parser(__doc__).parse_args()
    pairs = evaluate(arguments.photos, blur2view.SmearNetwork(arguments.model))
    if not pairs:
        raise SystemExit(f"no photograph with a measurement in {arguments.photos[0]}")
    found, true = (np.concatenate([pair[k] for pair in pairs.values()]) for k in (0, 1))
    figures = page({name: figures_of(*pair) for name, pair in pairs.items()})
    print(*figures, "", *octave_table(by_octave(found, true)), sep="\n")


if __name__ == "__main__":
    main()
