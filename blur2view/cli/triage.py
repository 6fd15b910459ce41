"""``blur2view triage``: which photographs are sharp, and which blurred ones are of use; options and work."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated

from blur2view.arrays import Array
from blur2view.cli import values
from blur2view.cli.adapter import group
from blur2view.cli.options import Common
from blur2view.cli.run import End, Finished, Photographs
from blur2view.cli.terminal import plural, printable, waiting
from blur2view.cli.values import Amount
from blur2view.cli.work import Setup
from blur2view.errors import Blur2ViewError, OutputError
from blur2view.images.image import read_image
from blur2view.images.selection import extract, refuse_filled, sharpest, sharpest_of_each, thumbnail
from blur2view.images.source import Source, read_content
from blur2view.networks.protocol import Detail
from blur2view.output_files import write_file
from blur2view.results.photograph import Photograph, explanations
from blur2view.results.verdict import MAX_DEFOCUS_PX, MAX_SMEAR_PX, Limits, Use, use_line
from blur2view.runs.jobs import Job, Outcome

COUNTED = {Use.SHARP: "sharp", Use.BLURRED: "blurred but of use", Use.UNUSABLE: "unusable"}
COUNTED_IF_ANY = {Use.OUT_OF_FOCUS: "out of focus", Use.UNCLEAR: "unclear: smooth or dark", "": "failed"}
USES = """
sharp: the smear of the picture is at most --max-smear, and the radius out of focus of what is in focus, if
    anything is, at most --max-defocus; kept
blurred: it is longer, but F or H explains the smears, so that the views of the exposure are of use (blur2view
    to-colmap); kept with --blurred only
unusable: it is longer, and no geometry explains it (DEGENERATE, UNDEFINED); kept by --best and --every-best
    only
out of focus: the lens, not a motion, blurs all of it; kept as unusable ones
unclear: nothing shows texture, or it is too dark: perhaps sharp; kept as unusable ones
the same photographs of another size: give the limit in per cent of the width. Frames that were compressed
    much again have shorter smears than those of their video; --extract compresses nothing
"""
LIST = """
--keep: names, one on a line, relative to the folder that was given or that all photographs share: what COLMAP
    takes as --image_list_path with that folder as --image_path. Written into that folder, it is also a list
    for blur2view, as @frames/keep.txt, from anywhere. Nothing else is in it; which of them are blurred stands
    in the table. No list that is there is replaced
--extract: files for COLMAP, ns-process-data and blur2view: frame 120 of a video (from 0) is frame_00120.png,
    with the pixels that were looked at, below the video's name if there are several; photographs are copied.
    The folder must be empty or new
--every-best: of every N neighbours in a video or folder one is kept, and another where it shows another view
"""


@dataclass(frozen=True, kw_only=True)
class Choice:
    """output.

    --keep LIST: write the list of photographs to keep, see below
    --extract DIR: write the photographs to keep into a folder, frames of videos as PNG, see below
    --blurred: keep the blurred ones, too, that geometry can use
    --best N: keep the N sharpest, or as 50%%, by the width of all of the blur
    --every-best N: keep the sharpest of every N neighbours, and of each view among them
    """

    effect, either = False, ("blurred", "best", "every_best")
    keep: Path | None = None
    extract: Path | None = None
    blurred: bool = False
    best: Annotated[Amount | None, values.best] = None
    every_best: int | None = None

    def __post_init__(self) -> None:
        if self.selects and self.keep is None and self.extract is None:
            raise ValueError("--best and --every-best choose what --keep LIST names or --extract DIR holds")

    @property
    def selects(self) -> bool:
        """Whether photographs are kept by their order of blur, whatever they are of use for."""
        return self.best is not None or self.every_best is not None

    def selected(self, rows: Mapping[Source, Photograph]) -> list[Source]:
        """Return the photographs to keep, in order."""
        read = [one for one, row in rows.items() if not row.error]
        widths = [rows[one].width_px for one in read]
        if self.best is not None:
            number = self.best.number
            count = max(round(len(read) * number / 100), 1) if self.best.percent else int(number)
            chosen = sharpest(widths, count)
        elif self.every_best is not None:
            series = [one.folder for one in read]
            chosen = sharpest_of_each(widths, series, self.every_best, lambda index: _view(read[index]))
        else:
            wanted = (Use.SHARP, Use.BLURRED) if self.blurred else (Use.SHARP,)
            return [one for one in read if rows[one].use in wanted]
        return [read[index] for index in sorted(chosen)]


@dataclass(frozen=True, kw_only=True)
class Sharp:
    """what is sharp.

    --max-smear PX: the longest smear of a sharp photograph, in pixels, or as 0.3%% of the picture's width
        (default: %(default)s, up to which half of its SIFT features are still matched)
    --max-defocus PX: the largest radius out of focus of a sharp photograph, in pixels (default: %(default)s)
    """

    effect = False
    max_smear: Annotated[Amount, values.smear] = Amount(number=MAX_SMEAR_PX)
    max_defocus: Annotated[float, values.radius] = MAX_DEFOCUS_PX

    @property
    def limits(self) -> Limits:
        """Up to where a photograph is called sharp."""
        longest = self.max_smear
        return Limits(max_smear=longest.number, percent=longest.percent, max_defocus_px=self.max_defocus)


@dataclass(frozen=True, kw_only=True)
class TriageOptions:
    """The options of ``blur2view triage``.

    Look at every photograph and say what blurred it, motion or a lens out of focus, and by how much: a table
    of all, and a list, or a folder, of those to use. Each is sharp; blurred but of use, where geometry
    explains its smears; unusable, where nothing does; out of focus; or unclear, where it is too smooth or too
    dark to show blur, which the variance of the Laplacian would confuse.
    """

    common: Common
    choice: Choice = group(Choice)
    sharp: Sharp = group(Sharp)

    examples = (
        "blur2view triage clip.mp4 --every-best 6 --extract frames",
        "blur2view triage frames --csv triage.csv --keep frames/keep.txt",
        "colmap feature_extractor --image_path frames --image_list_path frames/keep.txt --database_path a.db",
    )

    @staticmethod
    def tables() -> dict[str, str | Mapping[str, str]]:
        """Return what --help-all lists besides options."""
        return {"uses": USES, "columns of --csv": explanations(flat=True), "what is written": LIST}

    def execute(self) -> int:
        """Return the exit code, after looking at every photograph and writing table, list and pictures.

        A run that was ended early extracts nothing, and chooses nothing of neighbours.
        """
        photographs, choice = Photographs.of("triage", self), self.choice
        jobs = photographs.jobs()
        if choice.keep is not None:
            jobs = [replace(job, refusal=job.refusal or unlistable(job)) for job in jobs]
        with photographs.writing({"--extract": (choice.extract, ""), "--keep": (choice.keep, "list")}):
            if choice.extract is not None:
                refuse_filled(choice.extract)
            finished = photographs.run(jobs, partial(look_at, photographs.setup, self.sharp.limits))
            if finished.end is not End.STOPPED and finished.done:
                self._write(finished)
        return finished.exit_code

    def _write(self, finished: Finished) -> None:
        """Write list and pictures, and print the closing line."""
        choice, whole = self.choice, finished.end is End.WHOLE
        names = {job.source: job.name for job in finished.records}
        rows = {job.source: one for job, one in finished.records.items()}
        with waiting("choosing photographs"):
            kept = choice.selected(rows)
        written = [self.common.table.csv] if finished.has_table else []
        if choice.keep is not None and (whole or not choice.selects):
            text = "".join(f"{names[one]}\n" for one in kept)
            write_file(choice.keep, text.encode("utf-8", "surrogateescape"))
            written.append(choice.keep)
        if choice.extract is not None and whole and kept:
            with waiting(f"writing {len(kept)} pictures"):
                extract(choice.extract, {one: names[one] for one in kept})
            written.append(choice.extract)
        if not self.common.printing.quiet:
            counts = Counter(row.use for row in rows.values())
            uses = [f"{counts[use]} {words}" for use, words in COUNTED.items()]
            uses += [f"{counts[use]} {words}" for use, words in COUNTED_IF_ANY.items() if counts[use]]
            parts = [", ".join(uses)]
            if choice.keep is not None or choice.extract is not None:
                parts.append(f"{len(kept)} kept" if kept else f"none is kept: {self._remedy}")
            paths = " and ".join(printable(str(path)) for path in written if path is not None)
            parts += [f"wrote {paths}"] * bool(paths)
            print(f"{plural(len(rows), 'photograph')} in {finished.seconds:.1f} s: {'; '.join(parts)}")

    @property
    def _remedy(self) -> str:
        """What would keep photographs where none is kept."""
        limits = f"--max-smear is {self.sharp.max_smear}, --max-defocus {self.sharp.max_defocus:g}"
        return f"{limits}; --blurred keeps the blurred ones that are of use, --best 50% the sharper half"


def look_at(setup: Setup, limits: Limits, job: Job) -> Outcome:
    """Return the record of one photograph, which is looked at less closely: of its blur alone."""
    one = setup.estimated(job, detail=Detail.RANKING)
    record = setup.record(one, job).of_use(limits).of_blur_alone()
    summary = f"{printable(str(job.source))}: {use_line(record)}"
    summary += f": {record.verdict}" * setup.common.printing.verbose
    return Outcome(photograph=record, summary=summary, warnings=one.warnings)


def _view(source: Source) -> Array | None:
    """Return the thumbnail of a photograph, None of one that cannot be read any more."""
    try:
        return thumbnail(read_image(source.path, content=read_content(source)))
    except Blur2ViewError:
        return None


def unlistable(job: Job) -> OutputError | None:
    """Return why COLMAP's list of images, one name a line, cannot hold a photograph, if so."""
    if job.name.splitlines() == [job.name.strip()]:
        return None
    why = "has a line break in its name, or a blank at its end, which no list holds; rename it"
    return OutputError(f"{job.source}: {why}")
