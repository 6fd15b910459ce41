"""No two fields of a photograph's record contradict each other, as it is and at an eighth of its light."""

from pathlib import Path

import numpy as np
import pytest

import blur2view
from blur2view.arrays import AnyArray
from blur2view.records.record import Record
from blur2view.records.verdict import MAX_SMEAR_PX

MODELS = Path(__file__).resolve().parents[2] / "models"


def contradictions(one: Record) -> list[str]:
    """Return the claims, on fields that belong together, that do not hold for a record."""
    proven, limit_px = one.parallax == "proven", max(MAX_SMEAR_PX, one.smear_sigma_px or 0.0)
    turned = (one.rotation_probability or 0.0) >= (one.plane_probability or 0.0)
    at_rest = {
        "no smear is longer than its error": one.blur == "cannot tell" or (one.smear_px or 0.0) <= limit_px,
        "no geometry is given": not one.has_geometry() and one.config == "DEGENERATE",
    }
    moved = {
        "no motion is not the likeliest": one.model != "no motion" or (one.model_probability or 0.0) <= 0.5,
        "proven parallax names itself": proven == (one.config in ("UNCALIBRATED", "CALIBRATED")),
        "proven parallax is the likeliest": not (proven and one.models) or one.model == "parallax",
        "the likelier of rotation and plane is named": one.rotation_probability is None
        or one.config not in ("PANORAMIC", "PLANAR")
        or turned == (one.config == "PANORAMIC"),
        "the reason names the likeliest": proven or not one.has_geometry() or one.model in one.reason,
    }
    return [claim for claim, holds in (moved if one.moved() else at_rest).items() if not holds]


def dimmed(image: AnyArray) -> AnyArray:
    """Return a picture (H, W, 3), float32 in [0, 1], at an eighth of its 8-bit values."""
    return np.asarray(np.round(image / np.float32(8) * 255) / 255, np.float32)


def found(image: AnyArray) -> list[str]:
    """Return the contradictions of a photograph."""
    return contradictions(Record.from_estimate(blur2view.estimate(image), name="a.jpg"))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["sample.jpg", "sample_mover.jpg"])
def test_no_two_fields_of_the_samples_contradict(name: str) -> None:
    image = blur2view.read_image(MODELS / name)
    assert not found(image) and not found(dimmed(image))


@pytest.mark.slow
def test_estimate_and_segment_state_one_share_and_a_camera_changes_no_kind(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("blur2view.smears.camera_motion.in_doubt", lambda grid: True)
    image = blur2view.read_image(MODELS / "sample_mover.jpg")
    estimate = blur2view.estimate(image)
    mask = blur2view.segment(estimate, image)
    assert estimate.blur.moving_share == mask.shares["moving"] > 0.05
    one, other = (Record.from_estimate(estimate, name="a.jpg", mask=found) for found in (None, mask))
    assert one.moving_share == other.moving_share and one.verdict == other.verdict
    camera = blur2view.Camera.from_focal(800, image.shape[1::-1])
    assert blur2view.estimate(image, camera=camera).blur == estimate.blur


@pytest.mark.parametrize("value", [0.0, 0.5, 1.0])
def test_no_two_fields_of_plain_pictures_contradict(value: float) -> None:
    assert not found(np.full((240, 320, 3), value, np.float32))
