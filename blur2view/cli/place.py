"""``blur2view place``: the views of a linked project in COLMAP's model of its frames."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from blur2view.cli.options import Printing
from blur2view.cli.parser import rare_option, required, share
from blur2view.cli.terminal import complain, plural, printable, waiting
from blur2view.colmap.models import find_model, refuse_other_model, write_model
from blur2view.errors import DatabaseError
from blur2view.output import writable_folder

SHOWN = 3  # frames of each reason without -v
REMEDY = "link all frames of the video (blur2view to-colmap --link), or give --fraction if all are sharp"
WRITTEN = """
DIR: the model with the views, in COLMAP's binary format, and project.ini, which names the database and the
    folder of the frames. The model of an earlier call is replaced; a model that another program wrote is
    refused
"""


@dataclass(frozen=True, kw_only=True)
class PlaceOptions:
    """The options of ``blur2view place``.

    Add to COLMAP's model of some frames the views NAME#open and NAME#close, which blur2view to-colmap --link
    has written to their project. The frames keep their poses, and these are the camera's path; the smears
    show which part of the path each exposure covers.
    """

    database: Path = required("DB: COLMAP database with the views")
    model: Path = required("""MODEL: folder of COLMAP's model of the frames; of several models in a mapper's
        folder the largest one is taken""")
    frames_dir: Path = required("""FRAMES: folder of the frames of one video, which was COLMAP's
        --image_path; the numbers in their names are taken as their times""")
    output: Path = required("-o, --output DIR: folder for the new model")
    fraction: Annotated[float | None, share] = rare_option("""--fraction F: exposure time divided by frame
        interval, at most 1, if it is known (default: measured from the smears)""")
    printing: Printing = Printing()

    examples = (
        "blur2view to-colmap --db project.db --link --sequence frames",
        "blur2view place project.db model frames -o with_views",
        "blur2view to-transforms with_views",
    )
    exit_codes = {"1": "failed; stderr has a line with the reason, and nothing is written"}
    tables = {"what is written": WRITTEN}

    def execute(self) -> int:
        """Return the exit code, after writing the model."""
        # and SciPy with them, which no help needs
        from blur2view.colmap.placement import place_views
        from blur2view.exposure.sequence import frame_names

        with waiting("placing views", hidden=self.printing.quiet):
            names, model = frame_names(self.frames_dir), find_model(self.model, complain)
            refuse_other_model(self.output, model)
            writable_folder(self.output)
            placement = place_views(self.database, model, names, self.fraction)
            if not placement.placed:
                count = plural(len(placement.refused), "frame")
                raise DatabaseError(
                    f"{self.database}: none of its {count} with views shows how long an exposure is, because "
                    f"none follows another one in {self.frames_dir}; {REMEDY}"
                )
            write_model(placement.model, self.output, self.frames_dir, self.database)
        if not self.printing.quiet:
            for line in refused_lines(placement.refused, "placed", self.printing):
                print(line)
            summary = f"{printable(str(self.output))}: {printable(str(model))} with views"
            counts = f"{plural(len(placement.placed), 'frame')} placed, {len(placement.refused)} refused"
            shaken = ", which is a guess because the camera shakes faster than the frames follow each other"
            guess = "" if placement.measured else shaken
            print(f"{summary}: {counts}; exposure over frame interval {placement.fraction:.2f}{guess}")
        return 0


def refused_lines(refused: Mapping[str, str], action: str, printing: Printing) -> Iterator[str]:
    """Yield a line for each reason for which frames were refused; with -v every such frame is named."""
    for reason in dict.fromkeys(refused.values()):
        frames = [printable(name) for name, why in refused.items() if why == reason]
        examples = frames if printing.verbose else frames[:SHOWN]
        more = f" and {len(frames) - len(examples)} more (-v)" if len(frames) > len(examples) else ""
        yield f"not {action}, {printable(reason)}: {', '.join(examples)}{more}"
