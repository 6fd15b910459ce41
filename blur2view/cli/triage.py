"""``blur2view triage``: which photographs are sharp or of use; its columns are `records.record`'s."""

import os
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from itertools import groupby
from math import inf
from pathlib import Path
from typing import Annotated

import numpy as np

from blur2view.cli.batch.job import Job, Outcome
from blur2view.cli.batch.photograph import estimate_file
from blur2view.cli.batch.run import Run
from blur2view.cli.batch.summary import print_counts, print_summary, print_table
from blur2view.cli.choosing import Candidates, Chosen, Pictures
from blur2view.cli.options import STANDARD_OUTPUT, Command
from blur2view.cli.parser import Length, file_path, flag, length, neighbours, option, radius
from blur2view.cli.terminal import complain, verdict_line
from blur2view.errors import ImageError, OutputError, RunError
from blur2view.images.inputs import Source, frame_file
from blur2view.images.video import frame_times
from blur2view.output import write_file
from blur2view.records.record import LOOK, explanations
from blur2view.records.verdict import MAX_DEFOCUS_PX, MAX_SMEAR_PX, Use
from blur2view.results.triage import record_of_look
from blur2view.smears.blur import OVEREXPOSED, TOO_DARK

ROUNDED_S = 0.001  # bound: Matroska rounds times to it
USES = """
sharp: the smear is at most --max-smear, and the smallest radius of defocus in the photograph is at most
    --max-defocus; such photographs are kept
blurred: the smear is longer. With --blurred it also means that F or H explains the smears, so that the views
    of the exposure are of use (blur2view to-colmap), and these photographs are kept. --best and --every-best
    may keep any photograph
unusable: the smear is longer, and no geometry explains it; only --blurred looks for one, and it keeps none of
    these
out of focus: the lens blurs the whole photograph, and no motion does
unclear: the photograph is too dark or overexposed, has no texture, or its smears are no longer than their
    errors; it may be sharp. The column nothing_seen of --csv gives the reason
"""
LIST = """
--keep: a list with a name on each line, relative to the folder that was given or that all photographs share.
    COLMAP reads it as --image_list_path with that folder as --image_path. If it lies in that folder,
    blur2view reads it from anywhere as @frames/keep.txt. The list of an earlier call is replaced, unless you
    have changed it
--extract: files for COLMAP, ns-process-data and blur2view. Frame 120 of a video, counted from 0, becomes
    frame_00120.png, in a folder with the video's name if there are several videos; photographs are copied.
    The folder must be empty or new, or hold the files of an earlier call of this kind; files that are no
    longer kept are removed
--every-best: one of every N neighbours in a video or folder is kept, in the order of their names. Without
    --csv this option, and --best for videos, look once, and only at the quarter with the most gradient
    energy among up to 12 neighbours, two at least, so that the kind of blur is less sure than in the table;
    the others have no line. Of what is looked at, the width of the blur over the gradient energy decides
"""


@dataclass(frozen=True, kw_only=True)
class TriageOptions(Command):
    """The options of ``blur2view triage``.

    Measure what blurred each photograph, motion or a lens out of focus, and by how much. The command can
    write a table of all photographs, and a list or a folder of those to use. Each photograph is sharp,
    blurred, out of focus, or unclear; an unclear one is too smooth or too dark to show its blur, which the
    variance of the Laplacian would not notice. --blurred divides the blurred photographs into those whose
    smears a geometry explains, which are of use, and unusable ones.
    """

    either = ("blurred", "best", "every_best")
    keep: Annotated[Path | None, file_path] = option("--keep LIST: write the list of photographs to keep")
    extract: Path | None = option("""--extract DIR: write the photographs to keep into a folder, frames of
        videos as PNG""")
    blurred: bool = flag("""--blurred: also keep blurred photographs that a geometry explains, which takes
        longer""")
    best: int | None = option("""--best N: keep the N sharpest photographs, or the sharpest frame of each of N
        equal parts of a video; those called sharp come first, and then the width of all blur decides""")
    every_best: Annotated[float | None, neighbours] = option("""--every-best N: keep the sharpest of every N
        neighbours, or, with 0.5s, of every half second of a video""")
    max_smear: Annotated[Length, length] = option(
        """--max-smear PX: longest smear of a sharp photograph, in pixels or, as 0.3%%, in per cent of its
        width (default: %(default)s, up to which half of its SIFT features are still matched)""",
        Length(MAX_SMEAR_PX),
    )
    max_defocus: Annotated[float, radius] = option(
        """--max-defocus PX: largest radius of defocus of a sharp photograph, in pixels (default:
        %(default)s)""",
        MAX_DEFOCUS_PX,
    )

    exit_codes = Command.exit_codes | {
        "0": "done, whatever the photographs are good for",
        "130": "interrupted by Ctrl-C; the table of what is done is written, but no list and no picture",
    }
    examples = (
        "blur2view triage clip.mp4 --every-best 6 --extract frames",
        "blur2view triage frames --csv triage.csv --keep frames/keep.txt",
        "colmap feature_extractor --image_path frames --image_list_path frames/keep.txt --database_path a.db",
    )
    columns = LOOK
    tables = {
        "uses": USES,
        "columns of --csv": {name: text for name, text in explanations(flat=True).items() if name in LOOK},
        "columns that the tables of other commands add behind these": {
            name: text for name, text in explanations(flat=True).items() if name not in LOOK
        },
        "what is written": LIST,
    }

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.best or self.every_best) and self.keep is None and self.extract is None:
            raise ValueError("--best and --every-best choose what is kept; add --keep LIST or --extract DIR")
        for name, path in {"keep": self.keep, "csv": self.table.csv}.items():
            if self.extract and path not in (None, STANDARD_OUTPUT) and _is_below(path, self.extract):
                raise ValueError(
                    f"--{name} must lie outside of the folder of --extract, which has pictures alone"
                )

    def execute(self) -> int:
        """Return the exit code, after looking at every photograph and writing table, list and pictures.

        A run that ends early writes the table of what is done.
        """
        run = Run(self)
        if self.keep is not None:
            run.jobs = [_listable(job) for job in run.jobs]
        if self.extract is not None:
            refuse_filled(self.extract, extracted(self.extract, run.jobs).values())
        self._name_frames(run)
        if all(map(self.compares_gradients, run.jobs)):
            run.looked_at = Candidates(self._groups(run.jobs))
        with nullcontext() if self.extract is None else Pictures(self.extract) as pictures:
            chosen = self._chosen(run.jobs, pictures)
            run.passed = chosen.add
            run.do(look_at, print_summary, checked=self.extract, keep=self.keep)
            print_table(run)
            if run.done and not run.early_exit_code:
                self._write(run, chosen.kept(), pictures)
        return run.exit_code

    def _name_frames(self, run: Run) -> None:
        """Say on stderr that COLMAP cannot read a list of frames of videos, which get no files."""
        of_video = next((job.name for job in run.jobs if job.source.frame is not None), "")
        if self.keep is not None and of_video and self.extract is None and not self.printing.quiet:
            why = f"names frames of videos, as {of_video}, which blur2view reads and COLMAP does not"
            complain(RunError(f"{self.keep}: {why}; --extract DIR writes them as files"))

    def _write(self, run: Run, kept: Sequence[Job], pictures: Pictures | None) -> None:
        """Write list and pictures, and print the closing line."""
        if self.keep is not None:
            text = "".join(f"{job.name}\n" for job in kept)
            write_file(self.keep, text.encode("utf-8", "surrogateescape"), noted=True)
        if self.extract is not None and pictures is not None:
            targets = extracted(self.extract, run.jobs)
            failed = {job.source for job, outcome in run.outcomes if outcome.error}
            whole = {source: path for source, path in targets.items() if source not in failed}
            extract(whole, {job.source for job in kept}, pictures)
        if self.silent:
            return
        uses = Counter(str(outcome.record.use) for _, outcome in run.outcomes)
        said = "" if self.keep is None and self.extract is None else f"{len(kept)} kept"
        if said and isinstance(run.looked_at, Candidates):
            said += f" of {run.looked_at.there}"
        if said and not kept:
            limits = f"--max-smear is {self.max_smear}, --max-defocus {self.max_defocus:g}"
            remedy = f"{limits}; --blurred keeps the blurred ones that are of use, --best N the N sharpest"
            said = f"none is kept: {remedy}"
        reasons = Counter(outcome.record.nothing_seen for _, outcome in run.outcomes)
        exposed = ", ".join(f"{reasons[one]} {one}" for one in (TOO_DARK, OVEREXPOSED) if reasons[one])
        counted = {"": "failed"}  # other uses are called by their names
        if self.blurred:
            counted[Use.BLURRED] = "blurred but of use"
        if exposed:
            counted[Use.UNCLEAR] = f"{Use.UNCLEAR} ({exposed})"
        counts = {counted.get(use, use): uses[use] for use in (*Use, "")}
        print_counts(run, counts, run.table, self.keep, self.extract if kept else None, said=said)

    def compares_gradients(self, job: Job) -> bool:
        """Whether a photograph has neighbours, of which gradients leave out most before the network looks.

        A table has a row of all; the best of photographs that show different things are not neighbours.
        """
        of_video = self.best is not None and job.source.frame is not None
        return self.table.csv is None and (self.every_best is not None or of_video)

    def _groups(self, jobs: Sequence[Job]) -> list[list[Job]]:
        """Return the groups of photographs of each of which the sharpest is kept."""
        if self.best is not None and any(job.source.frame is None for job in jobs):
            return [[job] for job in jobs]
        if self.best is not None:
            return _equal_parts(jobs, self.best)
        folders, groups = dict[Path, list[Job]](), list[list[Job]]()
        for job in jobs:
            folders.setdefault(job.source.folder, []).append(job)
        for own in folders.values():
            if isinstance(self.every_best, float):
                groups += _parts(own, self.every_best)
            else:
                count = self.every_best or 1
                groups += [own[first : first + count] for first in range(0, len(own), count)]
        return groups

    def _chosen(self, jobs: Sequence[Job], pictures: Pictures | None) -> Chosen:
        """Return what takes the photographs that pass, and keeps some."""
        if self.best is not None or self.every_best is not None:
            return Chosen(jobs, self._groups(jobs), most=self.best, pictures=pictures)
        wanted = (Use.SHARP, Use.BLURRED) if self.blurred else (Use.SHARP,)
        return Chosen(jobs, [[job] for job in jobs], wanted=wanted, pictures=pictures)


def look_at(options: TriageOptions, job: Job) -> Outcome:
    """Return the record of one photograph; to choose one of some neighbours the first look is enough."""
    record = record_of_look(
        lambda **asked: estimate_file(options, job, **asked).record(),
        lambda record: (options.max_smear.px(record.width or 0), options.max_defocus),
        blurred=options.blurred,
        closer=not options.compares_gradients(job),
    )
    used = f"\n  use: {record.use}" if options.printing.verbose else ""
    return Outcome(record=record, summary=verdict_line(record) + used)


def _equal_parts(jobs: Sequence[Job], count: int) -> list[list[Job]]:
    """Return the frames of each of so many parts of videos, which have as many frames that are there.

    A part also holds frames behind its own that a video announces and does not have.
    """
    lengths = {path: _frame_count(path) for path in {job.source.path for job in jobs}}
    there = np.cumsum([(job.source.frame or 0) < lengths[job.source.path] for job in jobs])
    part_of = (there - 1).clip(0) * count // max(int(there[-1]), count)
    return [[jobs[k] for k in part] for _, part in groupby(range(len(jobs)), key=lambda k: part_of[k])]


def _frame_count(video: Path) -> float:
    """Return the number of frames that a video has, as far as that is known before they are decoded."""
    try:
        return len(frame_times(video))
    except ImageError:  # which is said where its frames are read
        return inf


def _parts(jobs: Sequence[Job], seconds: float) -> list[list[Job]]:
    """Return the frames of each such time of a video; ImageError for what is not a video."""
    first = jobs[0].source
    if first.frame is None:
        what = "is not a frame of a video; give --every-best a number"
        what = what if os.path.lexists(first.path) else "no such file; check the path"
        raise ImageError(first.refusal or f"{first}: {what}")
    times = frame_times(first.path)
    at = [times[min(job.source.frame or 0, len(times) - 1)] for job in jobs]
    parts = groupby(range(len(jobs)), key=lambda k: int((at[k] - at[0] + ROUNDED_S) / seconds))
    return [[jobs[k] for k in part] for _, part in parts]


def _is_below(path: Path, folder: Path) -> bool:
    """Return whether a file that may not be there yet lies in a folder."""
    return Path(os.path.abspath(folder)) in Path(os.path.abspath(path)).parents


def _listable(job: Job) -> Job:
    """Return a job, which is refused if a list cannot hold its name."""
    if not {"\n", "\r"} & set(job.name):
        return job
    why = f"{job.source}: a list cannot hold its name, which has a line break; rename it, or omit --keep"
    return replace(job, refusal=job.refusal or OutputError(why))


def extracted(folder: Path, jobs: Sequence[Job]) -> dict[Source, Path]:
    """Return the file in a folder that each photograph or frame gets.

    A photograph has its name; frame 120 of a video is ``frame_00120.png``, below the video's name if there
    are several, or if a photograph is called so.
    """
    usable = [job for job in jobs if not job.source.refusal]
    names = {job.source: Path(job.name) for job in usable}
    frames = {source: Path(frame_file(source.frame)) for source in names if source.frame is not None}
    several = len({source.path for source in frames}) > 1
    if several or not set(frames.values()).isdisjoint(names.values()):
        frames = {source: names[source].parent / name for source, name in frames.items()}
    return {source: folder / name for source, name in (names | frames).items()}


def refuse_filled(folder: Path, targets: Collection[Path]) -> None:
    """Raise OutputError for a folder that holds more than an earlier call of this kind writes there.

    A program would read it with the pictures.
    """
    if folder.exists() and not folder.is_dir():
        raise OutputError(f"{folder}: is not a folder; name another with --extract")
    ours = set(targets)
    paths = sorted(folder.rglob("*"), key=lambda path: (path.name.startswith("."), path))  # hidden ones last
    there = (path for path in paths if path.is_symlink() or not path.is_dir())
    if other := next((path for path in there if path not in ours), None):
        raise OutputError(f"{folder}: holds {other.relative_to(folder)}; name an empty folder with --extract")


def extract(targets: Mapping[Source, Path], kept: Collection[Source], pictures: Pictures) -> None:
    """Write photographs as they are, and frames of videos as PNG; remove those that are not kept any more.

    Of frames the ``pictures`` are written; only those that an earlier call wrote and this one does not keep
    are decoded once more. OutputError if a file cannot be written, or one that is there is not what would be
    written, ImageError if a photograph cannot be read.
    """
    there = [source for source, path in targets.items() if os.path.lexists(path)]
    for source in there:
        path = targets[source]
        if path.is_symlink() or path.read_bytes() != (pictures.get(source) or source.picture()):
            remedy = "move it away, or name an empty folder with --extract"
            raise OutputError(f"{path}: differs from what this call would write; {remedy}")
    for source in there:
        if source not in kept:
            targets[source].unlink()
    for source, path in targets.items():
        if source in kept and source not in there:
            write_file(path, pictures.get(source) or source.picture())
