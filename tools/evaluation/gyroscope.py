"""Smears of real photographs against measured ones.

``python -m tools.evaluation.gyroscope FOLDER`` reads pairs of a photograph and an ``.npz`` of the same name
with displacements up to sign: ``smear`` (h, w, 2) at pixels (4 j + 2, 4 i + 2), as a gyroscope measured them
(DeepGyro, Mustaniemi et al., WACV 2019), or ``flow`` (h, w, 2) at pixels (4 j + 1.5, 4 i + 1.5) and where it
is ``valid`` (h, w). It prints, per photograph, median length, direction errors over all and over the surer
half, and predicted over true length; and errors of all photographs by true length. No photograph ships.
"""

from collections.abc import Mapping

import numpy as np

import blur2view
from blur2view.arrays import AnyArray
from blur2view.smears.field import SmearField
from tools.arguments import Existing, run
from tools.evaluation.even_blur import photographs_of
from tools.evaluation.smear_figures import by_octave, octave_table
from tools.metrics import DIRECTION_MIN_PX
from tools.pages import table

HEAD = "photograph | px | direction, deg | certain half | signed | length ratio | spread of its log"


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


def figures_of(read: AnyArray, true: AnyArray, sigma: AnyArray) -> tuple[float, ...]:
    """Return how well smears (N, 2) agree with measured ones (N, 2): the columns of HEAD.

    Medians of the measured length, of the direction's error, degrees, over all and over the half of smaller
    sigma, there also with its sign; the length's ratio, and the median deviation of its logarithm.
    """
    found, measured = (d[..., 0] + 1j * d[..., 1] for d in (read, true))
    error_deg = np.degrees(np.angle(found**2 * np.conj(measured**2))) / 2
    ratio = np.log(np.maximum(abs(found), 1e-2) / np.maximum(abs(measured), 1e-2))
    sure = error_deg[sigma <= np.median(sigma)]
    medians = [np.median(one) for one in (abs(measured), abs(error_deg), abs(sure), sure)]
    return *medians, np.exp(np.median(ratio)), np.median(abs(ratio - np.median(ratio)))


def main(photos: list[Existing], *, model: Existing | None = None) -> None:
    """Print the figures of photographs in folders, and their medians (of magnitudes, as signs cancel)."""
    network, pairs = blur2view.SmearNetwork(model), {}
    for path in photographs_of(photos):
        if (truth := path.with_suffix(".npz")).exists():
            with np.load(truth) as file:
                field = network.predict(blur2view.read_image(path)).at_pixels()
                pairs[path.stem] = pairs_of(field, dict(file))
    if not pairs:
        raise SystemExit(f"no photograph with a measurement in {photos[0]}")
    rows = {name: figures_of(*pair) for name, pair in pairs.items()}
    rows["median"] = tuple(np.median(np.abs(list(rows.values())), axis=0))
    cells = [(name, f"{px:.1f}", *(f"{x:.2f}" for x in rest)) for name, (px, *rest) in rows.items()]
    found, true = (np.concatenate([pair[k] for pair in pairs.values()]) for k in (0, 1))
    print(*table(HEAD, cells), "", *octave_table(by_octave(found, true)), sep="\n")


if __name__ == "__main__":
    run(main)
