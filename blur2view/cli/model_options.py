"""The options of the commands that take COLMAP's models, frozen and checked."""

import math
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, kw_only=True)
class ToTransformsOptions:
    """Those of ``blur2view to-transforms``."""

    model: Path
    photographs: Path | None
    exposure: float
    output: Path
    dialect: str
    overwrite: bool
    verbosity: int

    def __post_init__(self) -> None:
        """Refuse an exposure time that is none."""
        if not 0 < self.exposure < math.inf:
            raise ValueError(f"--exposure must be positive and finite, got {self.exposure}")


@dataclass(frozen=True, kw_only=True)
class PlaceOptions:
    """Those of ``blur2view place``."""

    database: Path
    model: Path
    photographs: Path
    fraction: float | None
    output: Path
    verbosity: int

    def __post_init__(self) -> None:
        """Refuse a fraction that is none."""
        if self.fraction is not None and not 0 < self.fraction < math.inf:
            raise ValueError(f"--fraction must be positive and finite, got {self.fraction}")
