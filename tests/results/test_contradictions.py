"""No two fields of a photograph's record contradict each other, as it is and at an eighth of its light."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import blur2view
from blur2view.arrays import AnyArray
from blur2view.results.photograph import Photograph
from blur2view.results.verdict import MAX_DEFOCUS_PX, MAX_SMEAR_PX, use_of

MODELS = Path(__file__).resolve().parents[2] / "models"
USES = {
    "sharp": {"sharp"},
    "out of focus": {"out of focus"},
    "camera at rest": {"sharp", "out of focus"},
    "cannot tell": {"unclear"},
    "camera moved": {"sharp", "blurred", "unusable", "out of focus"},
    "out of focus and moved": {"blurred", "unusable", "out of focus"},
}


def contradictions(one: Photograph) -> Iterator[str]:
    """Yield a line for every two fields of a record that say different things."""
    use, moved, radius = use_of(one), one.moved(), one.defocus_px or 0.0
    if use not in USES[one.blur]:
        yield f"blur is {one.blur}, use {use}"
    if use == "sharp" and (radius > MAX_DEFOCUS_PX or (moved and (one.smear_px or 0) > MAX_SMEAR_PX)):
        yield f"use is sharp, smear {one.smear_px}, radius {radius}"
    if use == "blurred" and not one.has_geometry():
        yield "use is blurred without a geometry"
    if not moved:
        limit = max(MAX_SMEAR_PX, one.smear_sigma_px or 0.0)
        if one.blur != "cannot tell" and (one.smear_px or 0.0) > limit:
            yield f"blur is {one.blur}, smear {one.smear_px} +/- {one.smear_sigma_px} px"
        if one.has_geometry() or one.config != "DEGENERATE":
            yield f"blur is {one.blur}, config {one.config}"
        return
    if one.model == "no motion" and (one.model_probability or 0.0) > 0.5:
        yield f"likeliest is no motion, verdict {one.verdict}"
    if (one.parallax == "proven") != (one.config in ("UNCALIBRATED", "CALIBRATED")):
        yield f"parallax is {one.parallax}, config {one.config}"
    if one.parallax == "proven" and one.models and one.model != "parallax":
        yield f"parallax is proven, likeliest is {one.model}"
    if one.config in ("PANORAMIC", "PLANAR") and one.rotation_probability is not None:
        turned = one.rotation_probability >= (one.plane_probability or 0.0)
        if turned != (one.config == "PANORAMIC"):
            yield f"config is {one.config}, a rotation has {one.rotation_probability}"
    if one.models and one.has_geometry() and one.parallax != "proven" and one.model not in one.reason:
        yield f"likeliest is {one.model}, reason {one.reason}"


def dimmed(image: AnyArray) -> AnyArray:
    """Return a picture (H, W, 3), float32 in [0, 1], at an eighth of its 8-bit values."""
    return np.asarray(np.round(image / np.float32(8) * 255) / 255, np.float32)


def found(image: AnyArray) -> list[str]:
    """Return the contradictions of a photograph."""
    return list(contradictions(Photograph.of(blur2view.estimate(image), name="a.jpg")))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["sample.jpg", "sample_mover.jpg"])
def test_no_two_fields_of_the_samples_contradict(name: str) -> None:
    image = blur2view.read_image(MODELS / name)
    assert not found(image) and not found(dimmed(image))


@pytest.mark.slow
def test_estimate_and_segment_state_one_share_and_a_camera_changes_no_kind(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("blur2view.pipeline.in_doubt", lambda grid: True)
    image = blur2view.read_image(MODELS / "sample_mover.jpg")
    estimate = blur2view.estimate(image)
    mask = blur2view.segment(estimate, image)
    assert estimate.blur.moving_share == mask.shares["moving"] > 0.05
    one, other = (Photograph.of(estimate, name="a.jpg", mask=found) for found in (None, mask))
    assert one.moving_share == other.moving_share and one.verdict == other.verdict
    camera = blur2view.Camera.from_focal(800, image.shape[1::-1])
    assert blur2view.estimate(image, camera=camera).blur == estimate.blur


@pytest.mark.parametrize("value", [0.0, 0.5, 1.0])
def test_no_two_fields_of_plain_pictures_contradict(value: float) -> None:
    assert not found(np.full((240, 320, 3), value, np.float32))
