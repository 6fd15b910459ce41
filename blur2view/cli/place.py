"""``blur2view place``: the views of a linked project in COLMAP's model of its frames."""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from blur2view.cli.adapter import group
from blur2view.cli.options import Printing
from blur2view.cli.terminal import plural, printable, waiting
from blur2view.cli.values import share
from blur2view.colmap.models import FoundModel, find_model, refuse_other_model, write_model
from blur2view.errors import DatabaseError, ImageError
from blur2view.images.inputs import list_photographs

if TYPE_CHECKING:
    from blur2view.colmap.placement import Placement

REPLACED = "; in place of the model of an earlier call"
SHOWN = 3  # frames of each reason without -v
ALL_FRAMES = "link all frames of the video (blur2view to-colmap --link)"
WRITTEN = """
DIR: the model with the views, in COLMAP's binary format, and project.ini, which names the database and the
    folder of the frames. What an earlier call wrote is replaced; a model of another program is not, nor
    one that was refined since
"""


@dataclass(frozen=True, kw_only=True)
class PlaceOptions:
    """The options of ``blur2view place``.

    Put the views that blur2view to-colmap --link has written to a project, NAME#open and NAME#close, into
    COLMAP's model of the frames. The frames stay where they are; their poses are the camera's path, on which
    the smears say how long an exposure was.

    DB: the project with the views
    MODEL: folder of COLMAP's model of the frames, or of a mapper's models, of which the largest is taken
    FRAMES: folder of the frames, all of one video: COLMAP's --image_path. Where their numbers leave some
        out, no two are taken for neighbours
    -o, --output DIR: where the model goes
    Rarely:
    --fraction F: exposure time over frame interval, at most 1, if it is known (default: measured from the
        smears)
    """

    database: Path
    model: Path
    photographs: Path
    output: Path
    fraction: Annotated[float | None, share] = None
    printing: Printing = group(Printing)

    examples = (
        "blur2view to-colmap --db project.db --link --sequence frames",
        "blur2view place project.db model frames -o with_views",
        "blur2view to-transforms with_views",
    )

    @staticmethod
    def tables() -> dict[str, str | Mapping[str, str]]:
        """Return what --help-all lists besides options."""
        return {"what is written": WRITTEN}

    def execute(self) -> int:
        """Return the exit code, after writing the model."""
        with waiting("placing views") as show:
            names = frame_names(self.photographs)
            model = find_model(self.model)
            replaced = refuse_other_model(self.output)
            placement = self._placed(model, names, show)
            write_model(placement.model, self.output, self.photographs, self.database)
        if not self.printing.quiet:
            print("\n".join(self._summary(model, placement, names)) + REPLACED * replaced)
        return 0

    def _placed(self, model: FoundModel, names: list[str], show: Callable[[int, int], None]) -> "Placement":
        """Return the model with the views; DatabaseError if none can be placed."""
        from blur2view.colmap.placement import place_views  # and SciPy with it, which no help needs

        placement = place_views(self.database, model.folder, names, self.fraction, show)
        about = f"{self.database}: of {plural(placement.linked, 'frame')} with views"
        if not math.isfinite(placement.fraction):
            why = "no two follow one another and show how long an exposure is"
            raise DatabaseError(f"{about} {why}; {ALL_FRAMES}, or state --fraction")
        if not placement.placed:
            raise DatabaseError(f"{about} none has another frame next to it; {ALL_FRAMES}")
        return placement

    def _summary(self, model: FoundModel, placement: "Placement", names: list[str]) -> Iterator[str]:
        """Yield the lines of `model_lines` and one that counts all frames."""
        from blur2view.colmap.placement import RECOVERED

        recovered = [name for name, why in placement.refused.items() if why == RECOVERED]
        refused = {name: why for name, why in placement.refused.items() if why != RECOVERED}
        yield from model_lines(model, names, refused, "placed", self.printing)
        line = f"{printable(str(self.output))}: of {plural(placement.linked, 'linked frame')} "
        line += f"{len(placement.placed)} placed, {len(refused)} refused"
        line += f", {len(recovered)} recovered before" * bool(recovered)
        line += f"; exposure over frame interval {placement.fraction:.2f}"
        if not placement.measured:
            line += " for want of a better one: the camera shakes faster than the frames; state --fraction"
        yield line


def frame_names(folder: Path) -> list[str]:
    """Return the frames of a folder as COLMAP names them, in order; ImageError if there are none."""
    if not folder.is_dir():
        raise ImageError(f"{folder}: no such folder; name that of the frames")
    inputs = list_photographs([str(folder)], recursive=True)
    for reason in inputs.refused.values():
        raise ImageError(reason)
    return inputs.names()


def model_lines(
    model: FoundModel, names: list[str], refused: Mapping[str, str], action: str, printing: Printing
) -> Iterator[str]:
    """Yield a line about the model if it was chosen, and one for each reason for which frames were refused.

    With -v every such frame is named.
    """
    if model.others:
        size = f"{plural(model.registered, 'photograph')}, {plural(len(names), 'frame')} in the folder"
        yield f"{printable(str(model.folder))}: largest of {model.others + 1} models, {size}"
    for reason in dict.fromkeys(refused.values()):
        frames = [printable(name) for name, why in refused.items() if why == reason]
        shown = frames if printing.verbose else frames[:SHOWN]
        more = f" and {len(frames) - len(shown)} more (-v)" if len(frames) > len(shown) else ""
        yield f"not {action}, {reason}: {', '.join(shown)}{more}"
