"""``blur2view triage`` of a synthetic flight: smears on the ground, and two lists of one run."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from blur2view.arrays import Array
from tests.support.calls import call_program
from tests.support.tables import table

GSD_M, SPEED_M_S = 0.02, 10.0  # a metre is 50 pixels: 500 pixels a second
EXPOSURES_S = (1 / 4000, 1 / 1000, 1 / 125, 1 / 60, 1 / 30)
SMEARS_PX = [SPEED_M_S * exposure / GSD_M for exposure in EXPOSURES_S]  # 0.1, 0.5, 4, 8, 17


def ground(rng: np.random.Generator, width: int) -> Array:
    """Return fields of many sizes, linear light (480, width, 3)."""
    total = np.zeros((480, width, 3), np.float32)
    for scale, weight in ((0.8, 1.0), (3, 2.0), (12, 3.0)):
        noise = cv2.GaussianBlur(rng.normal(size=total.shape).astype(np.float32), (0, 0), scale)
        total += weight * noise / noise.std()
    return np.asarray(np.clip(0.4 + 0.12 * total, 0, 1))


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return photographs straight down, each of another exposure time."""
    folder, rng = tmp_path_factory.mktemp("flight"), np.random.default_rng(0)
    for number, smear in enumerate(SMEARS_PX):
        wide = ground(rng, 640 + 32)
        shifts = (np.arange(33) + 0.5) / 33 * smear
        pictures = [cv2.warpAffine(wide, np.array([[1, 0, -s], [0, 1, 0]]), (640, 480)) for s in shifts]
        coded = np.mean(pictures, axis=0) ** (1 / 2.2) + rng.normal(0, 0.004, (480, 640, 3))
        cv2.imwrite(str(folder / f"dsc_{number}.png"), np.round(255 * np.clip(coded, 0, 1)).astype(np.uint8))
    return folder


def test_a_flight_keeps_what_moved_by_less_than_a_ground_sample(
    flight: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    sheet, poses, training = (tmp_path / name for name in ("t.csv", "poses.txt", "train.txt"))
    lists = ("--keep-for-poses", poses, "--keep-for-training", training)
    done = call_program(
        capsys, "triage", flight, "--gsd", "2cm", "--csv", sheet, *lists, "--focal", 800, "--jobs", 1
    )
    assert done == 0
    rows = table(sheet)
    for row, smear in zip(rows, SMEARS_PX, strict=True):
        if smear > 2:
            assert float(row["smear_ground_m"]) == pytest.approx(GSD_M * smear, rel=0.15)
            assert row["use"] == "blurred" and "above 1 px; the camera's motion explains it" in row["reason"]
        else:
            assert float(row["smear_ground_m"]) < GSD_M and "at most 1 px" in row["reason"]
            assert row["use"] == "sharp"
    assert training.read_text().split() == ["dsc_0.png", "dsc_1.png"]
    assert poses.read_text().split() == [f"dsc_{k}.png" for k in range(5)]
    assert "cm on the ground" in done.out and f"wrote {sheet} and {poses} and {training}" in done.out
    again = ("triage", flight, "--gsd", "2cm", "--csv", sheet, *lists, "--resume", "--focal", 800)
    assert call_program(capsys, *again, "--max-smear", "10cm", "--jobs", 1) == 0
    assert len(training.read_text().split()) == 3  # of at most 5 px
