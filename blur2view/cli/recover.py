"""``blur2view recover``: frames that COLMAP refused, put into its model of the others."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from blur2view.cli.adapter import group
from blur2view.cli.options import Printing
from blur2view.cli.place import SHOWN, frame_names
from blur2view.cli.terminal import plural, printable, waiting
from blur2view.colmap.models import FoundModel, database_of, find_model, refuse_other_model, write_model
from blur2view.errors import DatabaseError

if TYPE_CHECKING:
    from blur2view.colmap.recovery import Recovery

TRACKS = "tracks.db"
WRITTEN = """
DIR: the model with the recovered frames, their views NAME#open and NAME#close, and what they observe in the
    tracks of its points; COLMAP's binary format and project.ini. What an earlier call wrote is replaced; a
    model of another program is not
"""


@dataclass(frozen=True, kw_only=True)
class RecoverOptions:
    """The options of ``blur2view recover``.

    Register the frames of a video that COLMAP's model lacks, because they are too blurred for its features. A
    patch of a registered neighbour is blurred as this frame is, and this frame as the neighbour is: then both
    carry the same blur, and match. Frames of the model keep their poses; a frame that does not agree with its
    neighbours is refused.

    MODEL: folder of COLMAP's model of some frames, or of a mapper's models, of which the largest is taken
    FRAMES: folder of all frames, of one video: COLMAP's --image_path. Where their numbers leave some out, no
        two are taken for neighbours
    -o, --output DIR: where the model goes
    --tracks DB: also write DIR/tracks.db, for videos without a sharp frame: a copy of the model's project
        with keypoints and verified matches of blurred patches, more exact than those of SIFT, to map anew
    --refine: adjust the recovered poses and the model's points together (bundle adjustment); other poses stay
    Rarely:
    --no-views: without both ends of the recovered frames' exposures
    """

    model: Path
    photographs: Path
    output: Path
    tracks: Path | None = None
    refine: bool = False
    views: bool = True
    printing: Printing = group(Printing)

    examples = ("blur2view recover model frames -o all_frames", "blur2view to-transforms all_frames")

    @staticmethod
    def tables() -> dict[str, str | Mapping[str, str]]:
        """Return what --help-all lists besides options."""
        return {"what is written": WRITTEN}

    def execute(self) -> int:
        """Return the exit code, after writing the model."""
        from blur2view.colmap import recovery  # and SciPy with it, which no help needs
        from blur2view.colmap.blurred_tracks import track_frames

        with waiting("recovering frames"):
            names = frame_names(self.photographs)
            model = find_model(self.model)
            refuse_other_model(self.output)
            how = recovery.RecoverOptions(refine=self.refine, views=self.views)
            found = recovery.recover_frames(model.folder, self.photographs, names, how)
            if found.refused and not found.recovered and self.tracks is None:
                first = next(iter(found.refused))
                about = f"{self.model}: none of the {len(found.refused)} frames that it lacks is recovered"
                raise DatabaseError(f"{about}; {first}: {found.refused[first]}")
            write_model(found.model, self.output, self.photographs, database_of(model.folder))
            if self.tracks is not None:
                track_frames(found.sequence, self.tracks, self.output / TRACKS)
        if not self.printing.quiet:
            print(summary(self, model, found))
        return 0


def summary(options: RecoverOptions, model: FoundModel, found: "Recovery") -> str:
    """Return a line about the model if it was chosen, one for refused frames each, and one that counts all.

    With -v all refused frames and the recovered ones, too.
    """
    lines = []
    if model.others:
        lines.append(f"{printable(str(model.folder))}: largest of {model.others + 1} models")
    for name, frame in found.recovered.items() if options.printing.verbose else ():
        points = plural(len(frame.points), "point")
        lines.append(f"{printable(name)} recovered by {points}, {frame.residual_px:.1f} px apart")
    refused = [f"{printable(name)} refused: {reason}" for name, reason in found.refused.items()]
    shown = refused if options.printing.verbose else refused[:SHOWN]
    lines += [*shown, *([f"and {len(refused) - len(shown)} more (-v)"] if len(refused) > len(shown) else [])]
    count = plural(len(found.registered) + len(found.recovered) + len(refused), "frame")
    said = f"{len(found.registered)} registered, {len(found.recovered)} recovered, {len(refused)} refused"
    lines.append(f"{printable(str(options.output))}: of {count} {said}")
    return "\n".join(lines)
