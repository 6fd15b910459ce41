"""Smears of real photographs against measured ones.

``python -m tools.evaluation.gyroscope FOLDER`` reads pairs of a photograph and an ``.npz`` of the same name
with displacements up to sign: ``smear`` (h, w, 2) at pixels (4 j + 2, 4 i + 2), as a gyroscope measured them
(DeepGyro, Mustaniemi et al., WACV 2019), or ``flow`` (h, w, 2) at pixels (4 j + 1.5, 4 i + 1.5) and where it
is ``valid`` (h, w). It prints, per photograph, how well smears of 4 px and more are read, as
`tools.evaluation.smear_figures` has it, and errors of all photographs by true length. No photograph ships.
"""

from collections.abc import Mapping

import numpy as np

import blur2view
from blur2view.arrays import AnyArray
from blur2view.smears.field import SmearField
from tools.arguments import Existing, run
from tools.evaluation.even_blur import photographs_of
from tools.evaluation.smear_figures import Smears, by_octave, evaluate_smears, octave_table
from tools.metrics import DIRECTION_MIN_PX
from tools.pages import record_table

HEAD = "photograph | px | direction, deg | certain half | length ratio | spread of its log"
ROW = (
    "{name} | {px:.1f} | {direction_deg:.2f} | {direction_deg_top50:.2f} | {length_ratio:.2f} "
    "| {length_spread:.2f}"
)


def measured_smears(field: SmearField, truth: Mapping[str, AnyArray]) -> Smears:
    """Return the smears of a photograph where something of 4 px and more was measured."""
    first, name = (2, "smear") if "smear" in truth else (1, "flow")
    h, w = np.minimum(field.sigma_px[first::4, first::4].shape, truth[name].shape[:2])
    true = truth[name][:h, :w].astype(float)
    known = np.hypot(true[..., 0], true[..., 1]) >= DIRECTION_MIN_PX
    if "valid" in truth:
        known &= truth["valid"][:h, :w]
    arrays = field.displacement, field.sigma_px, field.sigma_rad
    found, sigma, sigma_rad = (a[first::4, first::4][:h, :w][known] for a in arrays)
    sure = sigma_rad <= np.median(sigma_rad)
    return Smears(found=found.astype(float), true=true[known], sigma=sigma, sure=sure)


def main(photos: list[Existing], *, model: Existing | None = None) -> None:
    """Print the figures of photographs in folders, and errors by length."""
    network, every = blur2view.SmearNetwork(model), {}
    for path in photographs_of(photos):
        if (truth := path.with_suffix(".npz")).exists():
            with np.load(truth) as file:
                field = network.predict(blur2view.read_image(path)).at_pixels()
                every[path.stem] = measured_smears(field, dict(file))
    if not every:
        raise SystemExit(f"no photograph with a measurement in {photos[0]}")
    rows = [
        vars(evaluate_smears(smears)) | {"name": name, "px": np.median(np.linalg.norm(smears.true, axis=1))}
        for name, smears in every.items()
    ]
    columns = ("px", "direction_deg", "direction_deg_top50", "length_ratio", "length_spread")
    rows.append({"name": "median"} | {k: np.median([row[k] for row in rows]) for k in columns})
    found, true = (np.concatenate([getattr(one, of) for one in every.values()]) for of in ("found", "true"))
    print(*record_table(HEAD, ROW, rows), "", *octave_table(by_octave(found, true)), sep="\n")


if __name__ == "__main__":
    run(main)
