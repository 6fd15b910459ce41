"""``blur2view place``: the views of a linked project in COLMAP's model of its frames."""

import math
import os
import tempfile
from dataclasses import MISSING, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from blur2view.cli.arguments.option import INPUT, Options, Rows, option
from blur2view.cli.arguments.values import share
from blur2view.cli.terminal import plural, printable
from blur2view.colmap.models import PROJECT_FILE, FoundModel, find_model, is_ours, project_text
from blur2view.errors import DatabaseError, ImageError
from blur2view.exposure.views import CLOSE, OPEN
from blur2view.images.inputs import list_photographs
from blur2view.output_files import check_file, writable_folders, write_file

if TYPE_CHECKING:
    from blur2view.colmap.placement import Placement

ALL_FRAMES = "link all frames of the video (blur2view to-colmap --link)"
FILES = ("rigs.bin", "cameras.bin", "frames.bin", "images.bin", "points3D.bin")
WRITTEN = """
DIR: the model with the views, in COLMAP's binary format, and project.ini, which names the database and the
    folder of the frames. What an earlier call wrote is replaced; a model of another's is not
"""


@dataclass(frozen=True, kw_only=True)
class PlaceOptions(Options):
    """The options of ``blur2view place``.

    Put the views that blur2view to-colmap --link has written to a project, NAME#open and NAME#close, into
    COLMAP's model of the frames. The frames stay where they are; their poses are the camera's path, on which
    the smears say how long an exposure was.
    """

    command = "place"
    database: Path = option(MISSING, "DB", group=INPUT)
    "the project with the views"
    model: Path = option(MISSING, "MODEL", group=INPUT)
    "folder of COLMAP's model of the frames, or of a mapper's models, of which the largest is taken"
    photographs: Path = option(MISSING, "FRAMES", group=INPUT)
    """folder of the frames, all of one video: COLMAP's --image_path. Where their numbers leave some out, no
    two are taken for neighbours"""
    fraction: float | None = option(None, "F", group=INPUT, convert=share, rare=True)
    "exposure time over frame interval, at most 1, if it is known (default: measured from the smears)"
    output: Path = option(MISSING, "DIR", names="-o --output")
    "where the model goes"

    tables: ClassVar[dict[str, Rows]] = {"what is written": WRITTEN}
    examples = (
        "blur2view to-colmap --db project.db --link --sequence frames",
        "blur2view place project.db model frames -o with_views",
        "blur2view to-transforms with_views",
    )

    def execute(self) -> int:
        """Return the exit code, after writing the model."""
        from blur2view.colmap.placement import place_views  # and SciPy with it, which no help needs

        names = frame_names(self.photographs)
        model = find_model(self.model)
        refuse_foreign(self.output)
        placement = place_views(self.database, model.folder, names, self.fraction)
        count = plural(len(placement.placed) + len(placement.left), "frame")
        about = f"{self.database}: of {count} with views in {self.model}"
        if not math.isfinite(placement.fraction):
            why = "no two follow one another and show how long an exposure is"
            raise DatabaseError(f"{about} {why}; {ALL_FRAMES}, or state --fraction")
        if not placement.placed:
            raise DatabaseError(f"{about} none has another frame next to it; {ALL_FRAMES}")
        write_model(placement.model, self.output, project_text(self.photographs, self.database))
        if not self.quiet:
            print(summary(self, model, placement, names))
        return 0


def frame_names(folder: Path) -> list[str]:
    """Return the frames of a folder as COLMAP names them, in order; ImageError if there are none."""
    if not folder.is_dir():
        raise ImageError(f"{folder}: no such folder; name that of the frames")
    inputs = list_photographs([str(folder)], recursive=True)
    if inputs.refused:
        raise ImageError(inputs.refused[folder])
    return [path.relative_to(folder).as_posix() for path in inputs.paths]


def refuse_foreign(folder: Path) -> None:
    """Raise OutputError where a model that is not of an earlier call would be replaced."""
    for name in () if is_ours(folder) else (*FILES, PROJECT_FILE):
        check_file(folder / name, "model")


def write_model(model: Any, folder: Path, text: str) -> None:
    """Write a pycolmap.Reconstruction and the text of `project_text`; each file whole or not at all."""
    with writable_folders(folder):
        write_file(folder / PROJECT_FILE, os.fsencode(text))
        with tempfile.TemporaryDirectory(dir=folder) as beside:
            model.write(beside)
            for name in FILES:
                Path(beside, name).replace(folder / name)


def summary(options: PlaceOptions, model: FoundModel, placement: "Placement", names: list[str]) -> str:
    """Return a line about the model if it was chosen, one about what was placed, one about what is lacking.

    With -v also what was not placed.
    """
    lines = []
    if model.others:
        size = f"{plural(model.registered, 'photograph')}, {plural(len(names), 'frame')} in the folder"
        lines.append(f"{printable(str(model.folder))}: largest of {model.others + 1} models, {size}")
    placed = f"placed the views of {plural(len(placement.placed), 'frame')}"
    line = f"{printable(str(options.output))}: {placed}, exposure over frame interval "
    line += f"{placement.fraction:.2f}"
    if not placement.measured:
        line += " for want of a better one: the camera shakes faster than the frames; state --fraction"
    if placement.left:
        line += f", {len(placement.left)} left out, as no frame of the model is next to them by number"
    lines.append(line)
    if options.verbose:
        lines += [f"  {printable(name)} left out" for name in placement.left]
    posed = {image.name for image in placement.model.images.values() if image.has_pose}
    if missing := len({name for name in posed if not name.endswith((OPEN, CLOSE))}.difference(names)):
        frames = printable(str(options.photographs))
        lines.append(f"{frames}: lacks {missing} photographs of the model, which have no views; {ALL_FRAMES}")
    return "\n".join(lines)
