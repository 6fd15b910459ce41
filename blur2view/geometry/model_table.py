"""The table from which a model is chosen: every model with its likelihood and its probability."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class MotionModel(StrEnum):
    """Model of the camera's motion; in brackets its number of parameters."""

    STILL = "no motion"
    """A camera that holds still (0)."""
    ROTATION = "rotation"
    """H of a pure rotation (3, and 3 of the camera held by a prior)."""
    ROLLING_ROTATION = "rotation, rolling shutter"
    """A rotation whose rate changes down the rows of a rolling shutter (3 more, held by a prior)."""
    ROLLING_PLANE = "plane, rolling shutter"
    """A plane, and a rotation that changes down the rows (3 more, held by a prior)."""
    PLANE = "plane"
    """Any H (8)."""
    PARALLAX = "parallax"
    """A plane, and parallax along the lines of F (10)."""
    NONE = "none"
    """None: no models were compared."""


FAMILIES = {
    MotionModel.STILL: (MotionModel.STILL,),
    MotionModel.ROTATION: (MotionModel.ROTATION, MotionModel.ROLLING_ROTATION),
    MotionModel.PLANE: (MotionModel.PLANE, MotionModel.ROLLING_PLANE),
    MotionModel.PARALLAX: (MotionModel.PARALLAX,),
}
"""What a camera may have done, each with its models: a shutter of either kind."""


@dataclass(frozen=True, kw_only=True)
class ModelRow:
    """One model: its free parameters, its log-likelihood and its probability.

    The log-likelihood is that of the effective number of smears, with priors, 0 for smears without residuals
    whose orders are known.
    """

    model: MotionModel
    parameters: int
    log_likelihood: float
    probability: float


@dataclass(frozen=True, kw_only=True)
class ModelTable:
    """All models that were compared, likeliest first, on so many smears as if each erred for itself."""

    rows: tuple[ModelRow, ...] = ()
    effective_count: float = 0.0

    @property
    def winner(self) -> ModelRow | None:
        """The likeliest model, with its probability; None where none were compared."""
        return self.rows[0] if self.rows else None

    def probability(self, *models: MotionModel) -> float | None:
        """Return the probability that it is one of the models; None where none were compared."""
        if not self.rows:
            return None
        return sum(row.probability for row in self.rows if row.model in models)

    def likeliest(self) -> tuple[MotionModel, float]:
        """Return the likeliest of `FAMILIES` and its probability, which is 0 where none were compared."""
        odds = {name: self.probability(*models) or 0.0 for name, models in FAMILIES.items()}
        return max(odds.items(), key=lambda one: one[1])

    def lines(self) -> list[str]:
        """Return the table as text, likeliest first."""
        if not self.rows:
            return []
        smears = f"{self.effective_count:.0f} independent smears"
        return [
            f"model, parameters, log-likelihood of {smears}, probability",
            *(
                f"  {row.model:<26} {row.parameters:>2} {row.log_likelihood:>9.1f} {row.probability:6.3f}"
                for row in self.rows
            ),
        ]
