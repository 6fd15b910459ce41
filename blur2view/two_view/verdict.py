"""What the smears show, as data: the structures there are, and a verdict with its models and reason."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from blur2view.arrays import Array
from blur2view.geometry.two_view_geometry import MotionModel
from blur2view.two_view.model_selection import Fit


class Structure(StrEnum):
    """What the smears show."""

    STILL = "no motion"
    PARALLAX = "parallax"
    UNDECIDED = "parallax or none"
    ROTATION_UNDECIDED = "rotation or small parallax"
    PLANE_UNDECIDED = "plane or small parallax"
    ROTATION = "rotation"
    PLANE = "plane"
    ROTATION_OR_PLANE = "rotation or plane"
    SEVERAL = "several motions"
    NOTHING = "nothing"


HOMOGRAPHIES = {
    Structure.ROTATION: MotionModel.ROTATION,
    Structure.PLANE: MotionModel.PLANE,
    Structure.ROTATION_OR_PLANE: MotionModel.ROTATION_OR_PLANE,
}
WITHOUT_F = {Structure.NOTHING, Structure.STILL, *HOMOGRAPHIES}


@dataclass(frozen=True, kw_only=True, eq=False)
class Verdict:
    """What the smears show, why, and the models behind it.

    ``fit`` is the F (of normalised coordinates) to report where there is one, ``generator`` that of the
    homography.
    """

    structure: Structure
    sentence: str
    fit: Fit
    generator: Array | None = None

    @property
    def F(self) -> Array | None:
        """F of normalised coordinates, None where there is none."""
        if self.structure in WITHOUT_F:
            return None
        return self.fit.point.matrix()

    @property
    def model(self) -> MotionModel:
        """Model of F or, without F, of the homography."""
        if self.structure in WITHOUT_F:
            return HOMOGRAPHIES.get(self.structure, MotionModel.NONE)
        return self.fit.model
