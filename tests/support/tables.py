"""The table of ``--csv``: its columns, and its rows as they are written."""

import csv
from pathlib import Path

COLUMNS = [
    "name", "verdict", "parallax", "parallax_probability", "blur", "smear_px", "smear_sigma_px",
    "smear_percent", "defocus_px", "defocus_sigma_px", "width_px", "direction_deg", "sharpness",
    "rotation_deg", "frame", "timestamp_s", "wx", "wy", "wz", "sigma_wx", "sigma_wy", "sigma_wz",
    "rate_unit", "time_confidence", "inliers", "elapsed_s", "use", "error", "meaning",
]  # fmt: skip


def table(path: Path) -> list[dict[str, str]]:
    """Return the rows of a table, which has the columns of `COLUMNS`."""
    with path.open(newline="") as file:
        reader = csv.DictReader(file)
        rows = list(reader)
    assert reader.fieldnames == COLUMNS
    return rows
