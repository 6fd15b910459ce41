"""Smears of real photographs against those that a gyroscope measured.

``python -m tools.evaluation.gyroscope FOLDER`` reads pairs of a photograph and an ``.npz`` of the same name
whose ``smear`` (h, w, 2) is the displacement at pixels (4 j + 2, 4 i + 2), up to sign, and prints per
photograph: median length, direction errors over all and over the surer half, and predicted over true length.
Format and data: DeepGyro (Mustaniemi et al., WACV 2019); no licence is stated, so none of it ships.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass
from pathlib import Path

import numpy as np

import blur2view
from blur2view.arrays import AnyArray
from blur2view.smears.field import SmearField
from tools.arguments import existing, parser_of

SUFFIXES = (".png", ".jpg")


@dataclass(frozen=True, kw_only=True)
class GyroscopeFigures:
    """Medians over one photograph; degrees, the length ratio, and the median deviation of its logarithm."""

    length_px: float
    direction_deg: float
    direction_deg_top50: float
    signed_deg_top50: float
    length_ratio: float
    length_spread: float


def figures_of(field: SmearField, smear: AnyArray) -> GyroscopeFigures:
    """Return how well a field agrees with measured smears (h, w, 2) at pixels (4 j + 2, 4 i + 2)."""
    rows, columns = smear.shape[:2]
    read = field.displacement[2::4, 2::4][:rows, :columns].astype(float)
    sigma = field.sigma_px if field.sigma_rad is None else field.sigma_rad
    sigma = sigma[2::4, 2::4][:rows, :columns]
    true = smear[: read.shape[0], : read.shape[1]].astype(float)
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


def evaluate(folder: Path, network: blur2view.SmearNetwork) -> dict[str, GyroscopeFigures]:
    """Return the figures of every photograph of a folder that has a measurement, by name."""
    figures = {}
    for path in sorted(p for p in folder.iterdir() if p.suffix in SUFFIXES):
        truth = path.with_suffix(".npz")
        if truth.exists():
            with np.load(truth) as file:
                figures[path.stem] = figures_of(
                    network.predict(blur2view.read_image(path)).at_pixels(), file["smear"]
                )
    return figures


def table(figures: dict[str, GyroscopeFigures]) -> str:
    """Return figures as lines of Markdown, their medians last (of magnitudes, as signs cancel)."""
    lines = [
        "| photograph | px | direction, deg | certain half | signed | length ratio | spread of its log |",
        "|---|---|---|---|---|---|---|",
    ]
    rows = {name: astuple(row) for name, row in figures.items()}
    rows["median"] = tuple(np.median(np.abs(list(rows.values())), axis=0))
    for name, (length, *others) in rows.items():
        lines.append(f"| {name} | {length:.1f} | " + " | ".join(f"{value:.2f}" for value in others) + " |")
    return "\n".join(lines)


def main() -> None:
    """Command line."""
    parser = parser_of(__doc__)
    parser.add_argument("folder", type=existing, help="photographs, and their measurements as .npz")
    parser.add_argument("--model", type=existing, help="ONNX file; the shipped one by default")
    arguments = parser.parse_args()
    if not arguments.folder.is_dir():
        raise SystemExit(f"{arguments.folder}: no such folder")
    figures = evaluate(arguments.folder, blur2view.SmearNetwork(arguments.model))
    if not figures:
        raise SystemExit(f"no photograph with a measurement in {arguments.folder}")
    print(table(figures))


if __name__ == "__main__":
    main()
