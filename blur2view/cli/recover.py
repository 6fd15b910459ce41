"""``blur2view recover``: frames that COLMAP refused, put into its model of the others."""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from blur2view.cli.options import Printing
from blur2view.cli.parser import Length, flag, length, option, rare_option, required
from blur2view.cli.place import refused_lines
from blur2view.cli.terminal import INTERRUPTED, complain, plural, printable, waiting
from blur2view.colmap.models import (
    DATABASE,
    find_model,
    holds_model,
    noted,
    read_ids,
    refuse_other_model,
    write_model,
)
from blur2view.errors import DatabaseError, OutputError, RunError
from blur2view.output import writable_folder

if TYPE_CHECKING:
    from blur2view.colmap.frame_sequence import FrameSequence
    from blur2view.colmap.models import DatabaseIds
    from blur2view.colmap.recovery import Recovery
    from blur2view.colmap.recovery_run import Notes

TRACKS, NOTES = "tracks.db", "recovering.jsonl"
WRITTEN = """
DIR: the model with the recovered frames, which observe its points, in COLMAP's binary format, and
    project.ini. The model of an earlier call is replaced; a model that another program wrote is refused
Ctrl-C: DIR then holds the model with the frames that are recovered so far, and recovering.jsonl, from which
    the same call goes on
views: the poses of a recovered frame at shutter-open and shutter-close, as images NAME#open and NAME#close.
    to-transforms reads them. They have no files, so that undistorters and most loaders of COLMAP's models
    fail on them
"""
EVERY_FRAME_BLURRED = """
1: with features, matching = blur2view.blurred_options(), call pycolmap.extract_features(DB, FRAMES,
    extraction_options=features) and pycolmap.match_exhaustive(DB, matching_options=matching); this takes
    about ten seconds for a photograph of 640x480. If the frames are dark or were taken under water, first
    call blur2view.write_stretched(FRAMES, COPIES), and extract the features from COPIES
2: call pycolmap.incremental_mapping(DB, FRAMES, MODELS); recover takes the largest of these models
3: run blur2view recover MODELS FRAMES -o DIR --tracks DB, which takes some seconds for a frame
4: call pycolmap.incremental_mapping(DIR/tracks.db, FRAMES, ANEW); if the model has few frames, it began
    with a wrong pair of frames, and another random_seed in the options helps
"""


@dataclass(frozen=True, kw_only=True)
class RecoverOptions:
    """The options of ``blur2view recover``.

    Register the frames of a video that COLMAP's model lacks because they are too blurred for its features. A
    patch of a registered neighbour gets the blur of this frame, and this frame gets the blur of the
    neighbour; then both have the same blur, and match. Frames of the model keep their poses, but for those of
    --max-smear, and a frame that does not agree with its neighbours is refused.
    """

    model: Path = required("""MODEL: folder of COLMAP's model of some frames; of several models in a mapper's
        folder the largest one is taken""")
    frames_dir: Path = required("""FRAMES: folder of all frames of one video, which was COLMAP's
        --image_path; the numbers in their names are taken as their times""")
    output: Path = required("-o, --output DIR: folder for the new model")
    tracks: Path | None = option("""--tracks DB: also write DIR/tracks.db, a copy of the model's database DB
        from which COLMAP maps anew; it holds keypoints and verified matches of blurred patches, which are
        more exact than those of SIFT. It is for videos without a sharp frame""")
    database: Path | None = rare_option("""--db DB: let recovered frames keep their keypoints of the model's
        database DB, so that COLMAP's mappers go on with the model and the database; the frames then observe
        fewer points""")
    max_smear: Annotated[Length | None, length] = option("""--max-smear PX: also give a new pose to frames of
        the model whose smears are longer, in pixels or, as 2%%, in per cent of their width, and to those that
        see little and do not fit the others; COLMAP's pose stays where none is found""")
    refine: bool = flag("""--refine: adjust the recovered poses and the model's points together (bundle
        adjustment); other poses stay as they are""")
    views: bool = flag("""--views: also add both views of each recovered frame (default: only if MODEL has
        views)""")
    jobs: int | None = option("""--jobs N: number of processes, each with one thread; the results do not
        depend on it (default: one per core)""")
    printing: Printing = Printing()

    examples = (
        "blur2view recover model frames -o all_frames",
        "blur2view recover model frames --max-smear 12 --views -o with_views",
        "blur2view to-transforms with_views",
    )
    exit_codes = {
        "1": "failed, or no frame could be recovered; stderr has the cause",
        "130": "interrupted by Ctrl-C; what is recovered so far is written, and the same call goes on",
    }
    tables = {"what is written": WRITTEN, "where every frame is blurred": EVERY_FRAME_BLURRED}

    def execute(self) -> int:
        """Return the exit code, after writing the model."""
        # and SciPy with them, which no help needs
        from blur2view.colmap.blurred_tracks import track_frames
        from blur2view.colmap.frame_sequence import FrameSequence
        from blur2view.colmap.recovery import finished_recovery
        from blur2view.exposure.sequence import frame_names
        from blur2view.networks.smear_network import SmearNetwork

        model = self._find_model()
        names = frame_names(self.frames_dir)
        self._check_targets(model, names)
        database, ids = self._database(model)
        quiet = self.printing.quiet
        sequence = FrameSequence(model, self.frames_dir, names, SmearNetwork())
        notes = self._set_aside(sequence)
        with waiting("recovering frames", hidden=quiet) as show:
            interrupted = self._recover(sequence, notes, show)
            recovery = finished_recovery(
                sequence, ids, self.database, views=self.views or None, refine=self.refine
            )
            write_model(recovery.model, self.output, self.frames_dir, database)
        if self.tracks is not None and not interrupted:
            with waiting("matching blurred patches", hidden=quiet) as show:
                track_frames(sequence, self.tracks, self.output / TRACKS, show)
        if not interrupted:
            notes.remove()
        if not quiet:
            self._print(recovery, model, len(names), tracked=self.tracks is not None and not interrupted)
            if self.database is None and ids is not None and recovery.recovered.keys() & ids.images.keys():
                # COLMAP's mappers refuse images that have another number of keypoints than the database
                named = printable(str(database))
                print(f"for COLMAP to go on with this model and {named}, recover with --db {named}")
        if interrupted:
            asked = sum(map(len, sequence.rounds()))
            left = plural(asked - len(sequence.recovered) - len(sequence.refused), "frame")
            complain(RunError(f"interrupted with {left} left; the same call goes on"))
        return INTERRUPTED if interrupted else 0

    def _find_model(self) -> Path:
        """Return the folder of the model; DatabaseError if it is named in the place of the frames."""
        model = find_model(self.model, complain)
        if not holds_model(model) and holds_model(find_model(self.frames_dir)):
            raise DatabaseError(
                f"{self.model}: has no COLMAP model, but {self.frames_dir} has; name the model first"
            )
        return model

    def _set_aside(self, sequence: "FrameSequence") -> "Notes":
        """Return the notes of this call, after setting aside the frames that get a new pose."""
        from blur2view.colmap.recovery_run import Notes, set_aside_blurred
        from blur2view.networks.model_file import usable_cores

        jobs, notes = self.jobs or usable_cores(), self.output / NOTES
        if self.max_smear is None:
            return Notes(notes, sequence)
        longest_px = self.max_smear.px(next(iter(sequence.model.cameras.values())).width)
        noted = Notes(notes, sequence, longest_px)
        try:
            with waiting("reading smears", hidden=self.printing.quiet) as show:
                set_aside_blurred(sequence, longest_px, jobs=jobs, notes=noted, show=show)
        except DatabaseError:  # nothing is written
            noted.remove()
            raise
        return noted

    def _check_targets(self, model: Path, names: Sequence[str]) -> None:
        """Refuse, before any work, what cannot be written, and a project for --tracks that cannot be used."""
        from blur2view.colmap.blurred_tracks import check_project

        refuse_other_model(self.output, model)
        writable_folder(self.output)
        if self.tracks is not None:
            if os.path.lexists(tracks := self.output / TRACKS):
                raise OutputError(f"{tracks}: already exists; move it away, or name another folder with -o")
            check_project(self.tracks, names)

    def _database(self, model: Path) -> tuple[Path | None, "DatabaseIds | None"]:
        """Return the database that an option or the model's project.ini names, and its ids."""
        named = self.database or self.tracks
        database = named or noted(model, DATABASE)
        try:
            return database, None if database is None else read_ids(database)
        except DatabaseError:
            if named:
                raise
            return database, None  # nobody asked for the one that is noted

    def _recover(self, sequence: "FrameSequence", notes: "Notes", show: Callable[[int, int], None]) -> bool:
        """Recover the missing frames, and return whether Ctrl-C interrupted it, with some recovered.

        DatabaseError if none could be.
        """
        from blur2view.colmap.recovery_run import recover_all
        from blur2view.networks.model_file import usable_cores

        interrupted = False
        try:
            recover_all(sequence, jobs=self.jobs or usable_cores(), notes=notes, show=show)
        except KeyboardInterrupt:
            if not sequence.recovered:
                raise
            interrupted = True
        lacking_still = {name: why for name, why in sequence.refused.items() if name not in sequence.aside}
        if lacking_still and not sequence.recovered and self.tracks is None:
            notes.remove()
            name, why = next(iter(lacking_still.items()))
            count = len(lacking_still)
            lacking = f"any of its {count} missing frames" if count > 1 else "its missing frame"
            raise DatabaseError(f"{sequence.source}: could not recover {lacking}; {name}: {why}")
        return interrupted

    def _print(self, recovery: "Recovery", model: Path, count: int, *, tracked: bool) -> None:
        """Print what became of the frames, so many in all."""
        if absent := recovery.sequence.absent():
            lacked = f"lacks the model's image {absent[0]}; its pose stays, and predicts no frame"
            if len(absent) > 1:
                lacked = f"lacks {len(absent)} images of the model, the first of which is {absent[0]}"
                lacked += "; their poses stay, and predict no frame"
            print(printable(f"{self.frames_dir}: {lacked}"))
        for line in refused_lines(recovery.refused, "recovered", self.printing):
            print(line)
        for name, frame in recovery.recovered.items() if self.printing.verbose else ():
            points = plural(len(frame.points), "point")
            off = f"{frame.residual_px:.1f} px (median) from where they were found"
            print(f"{printable(name)} recovered by {points}, which its pose puts {off}")
        more = f"and more, and {TRACKS}" if tracked else "and more"
        counts = f"{len(recovery.recovered)} recovered, {len(recovery.refused)} refused"
        registered = f"of {plural(count, 'frame')} {len(recovery.registered)} registered"
        print(f"{printable(str(self.output))}: {printable(str(model))} {more}: {registered}, {counts}")
