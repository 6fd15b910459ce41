"""What the pipeline asks of a network that reads smears, so that another architecture is one file."""

from enum import StrEnum
from typing import Protocol

from blur2view.arrays import AnyArray
from blur2view.networks.model_file import Execution
from blur2view.smears.grid import SmearGrid


class Detail(StrEnum):
    """What a photograph is read for."""

    GEOMETRY = "geometry"  # motion and masks: of more than 2.5 megapixels some thousand windows
    RANKING = "ranking"  # the order of photographs by their blur: some fifty to two hundred windows


class SmearReader(Protocol):
    """A network that reads the smears of a photograph, as `SmearNetwork` does."""

    @property
    def model_id(self) -> str:
        """Name of the weights, which results state."""

    @property
    def execution(self) -> Execution:
        """What runs it, and then the networks that find movers."""

    def predict(self, image: AnyArray, *, detail: Detail = Detail.GEOMETRY) -> SmearGrid:
        """Return the smears of a photograph (H, W, 3) or (H, W): uint8, uint16, or floats in [0, 1]."""
