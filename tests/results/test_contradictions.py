"""No two fields of a photograph's record contradict each other, as it is and at an eighth of its brightness.

``python -m tools.evaluation.contradictions FOLDERS`` asks so of all photographs at hand.
"""

from pathlib import Path

import numpy as np
import pytest

import blur2view
from blur2view.arrays import AnyArray
from blur2view.results.photograph import Photograph
from blur2view.results.triage_class import MAX_DEFOCUS_PX
from blur2view.smears.blur import DEFOCUSED_PX
from tools.evaluation.contradictions import contradictions, dimmed

MODELS = Path(__file__).resolve().parents[2] / "models"


def found(image: AnyArray) -> list[str]:
    """Return the contradictions of a photograph."""
    return list(contradictions(Photograph.of(blur2view.estimate(image), name="a.jpg")))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["sample.jpg", "sample_mover.jpg"])
def test_no_two_fields_of_the_samples_contradict(name: str) -> None:
    image = blur2view.read_image(MODELS / name)
    assert not found(image) and not found(dimmed(image))


@pytest.mark.parametrize("value", [0.0, 0.5, 1.0])
def test_no_two_fields_of_plain_pictures_contradict(value: float) -> None:
    assert not found(np.full((240, 320, 3), value, np.float32))


def test_out_of_focus_is_the_same_radius_everywhere() -> None:
    assert MAX_DEFOCUS_PX == DEFOCUSED_PX
