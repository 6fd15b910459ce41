"""``blur2view triage``: which photographs are sharp, and which blurred ones are of use; options and work."""

import os
from collections import Counter, deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated

from blur2view.arrays import Array
from blur2view.cli import values
from blur2view.cli.adapter import group
from blur2view.cli.options import Estimating, Lens, Many, Printing, Rates, Reading, Resuming, Table
from blur2view.cli.photographs import End, Finished, Photographs, is_folder
from blur2view.cli.terminal import plural, printable, waiting
from blur2view.cli.values import METRES, PERCENT, Amount
from blur2view.cli.work import Setup
from blur2view.errors import Blur2ViewError, OutputError
from blur2view.images.content import read_content
from blur2view.images.image import read_image
from blur2view.images.selection import (
    extract,
    extracted_names,
    refuse_others,
    sharpest,
    sharpest_of_each,
    thumbnail,
)
from blur2view.images.source import Source
from blur2view.networks.protocol import Detail
from blur2view.output_files import SUMS, write_file
from blur2view.results.photograph import Photograph, explanations
from blur2view.results.triage_class import MAX_DEFOCUS_PX, MAX_SMEAR_PX, NEAR, Limits, Use, classified
from blur2view.runs.job import Job, Outcome
from blur2view.runs.journal import ENDING

MAX_SMEAR = Amount(number=MAX_SMEAR_PX)
ONE_SAMPLE = Amount(number=1.0)
"""Longest smear of a sharp aerial photograph: a ground sample (photogrammetry asks for less than one)."""
KEPT = {"--keep-for-poses": (Use.SHARP, Use.BLURRED), "--keep-for-training": (Use.SHARP,)}
"""The uses of what lists other than --keep name."""
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
near the limit: within a tenth of it a frame is sharp if the one before it in its video is
the same photographs of another size: give the limit in per cent of the width. Frames that were compressed
    much again have shorter smears than those of their video; --extract compresses nothing
"""
LIST = f"""
--keep: names, one on a line, relative to the folder that was given or that all photographs share: what COLMAP
    takes as --image_list_path with that folder as --image_path. Written into that folder, it is also a list
    for blur2view, as @frames/keep.txt, from anywhere. Nothing else is in it; which of them are blurred stands
    in the table
--keep-for-poses, --keep-for-training: lists as that of --keep, whatever --best and --every-best choose:
    blurred photographs help to find poses, as views of their exposure, and harm radiance fields that know
    no blur
--extract: files for COLMAP, ns-process-data and blur2view: frame 120 of a video (from 0) is frame_00120.png,
    with the pixels that were looked at, below the video's name if there are several; photographs are copied.
    The folder must hold nothing else, and nothing in it is replaced
--every-best: of every N neighbours in a video or folder one is kept, and another where it shows another view
{SUMS}: hidden beside lists and tables, their SHA-256: what was changed since is not replaced
.*{ENDING}: hidden beside the first of these files, what --resume goes on with
"""


@dataclass(frozen=True, kw_only=True)
class Choice:
    """output.

    --keep LIST: write the list of photographs to keep, see below
    --extract DIR: write the photographs to keep into a folder, frames of videos as PNG, see below
    --blurred: keep the blurred ones, too, that geometry can use
    --best N: keep the N sharpest, or as 50%%, by the width of all of the blur
    --every-best N: keep the sharpest of every N neighbours, and of each view among them
    Rarely:
    --keep-for-poses LIST: write a list of the sharp ones and the blurred ones of use
    --keep-for-training LIST: write a list of the sharp ones
    """

    effect, either = False, ("blurred", "best", "every_best")
    keep: Path | None = None
    extract: Path | None = None
    blurred: bool = False
    best: Annotated[Amount | None, values.best] = None
    every_best: int | None = None
    keep_for_poses: Path | None = None
    keep_for_training: Path | None = None

    @property
    def lists(self) -> dict[str, Path]:
        """The lists of the call, by their options."""
        named = {
            "--keep": self.keep,
            "--keep-for-poses": self.keep_for_poses,
            "--keep-for-training": self.keep_for_training,
        }
        return {name: path for name, path in named.items() if path is not None}

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
            count = max(round(len(read) * number / 100), 1) if self.best.unit == PERCENT else int(number)
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

    --max-smear PX: the longest smear of a sharp photograph, in pixels, as 0.3%% of the picture's width, or
        with --gsd as 3cm (default: 3, up to which half of its SIFT features are still matched; with --gsd 1,
        a ground sample)
    --max-defocus PX: the largest radius out of focus of a sharp photograph, in pixels (default: %(default)s)
    --sequence: the photographs of a folder are the frames of a video: near the limit each is as sharp as the
        one before
    Rarely:
    --gsd LENGTH: the ground sample distance, as 2cm, of aerial photographs: those smeared within one are
        sharp
    """

    effect = False
    max_smear: Annotated[Amount | None, values.smear] = None
    max_defocus: Annotated[float, values.radius] = MAX_DEFOCUS_PX
    in_order: bool = False
    gsd: Annotated[float | None, values.metres] = None

    def __post_init__(self) -> None:
        if self.max_smear is not None and self.max_smear.unit == METRES and self.gsd is None:
            raise ValueError("--max-smear on the ground needs --gsd, what a pixel shows, as 2cm")

    @property
    def longest(self) -> Amount:
        """The longest smear of a sharp photograph."""
        return self.max_smear or (MAX_SMEAR if self.gsd is None else ONE_SAMPLE)

    def classifier(self) -> Callable[[Photograph], Photograph]:
        """Return what gives photographs, one after the other, with their use."""
        unit = self.longest.unit.strip()
        limits = Limits(
            max_smear=self.longest.number, unit=unit, max_defocus_px=self.max_defocus, gsd_m=self.gsd
        )
        waiting: deque[Photograph] = deque()

        def rows() -> Iterator[Photograph]:
            while True:
                yield waiting.popleft()

        found = classified(rows(), limits, in_order=self.in_order)

        def classify(one: Photograph) -> Photograph:
            waiting.append(one)
            return next(found)

        return classify


@dataclass(frozen=True, kw_only=True)
class TriageOptions:
    """The options of ``blur2view triage``.

    Look at every photograph and say what blurred it, motion or a lens out of focus, and by how much: a table
    of all, and a list, or a folder, of those to use. Each is sharp; blurred but of use, where geometry
    explains its smears; unusable, where nothing does; out of focus; or unclear, where it is too smooth or too
    dark to show blur, which the variance of the Laplacian would confuse.
    """

    reading: Reading
    choice: Choice = group(Choice)
    table: Table = group(Table)
    sharp: Sharp = group(Sharp)
    lens: Lens = group(Lens)
    rates: Rates = group(Rates)
    estimating: Estimating = group(Estimating)
    many: Many = group(Many)
    resuming: Resuming = group(Resuming)
    printing: Printing = group(Printing)

    examples = (
        "blur2view triage clip.mp4 --every-best 6 --extract frames",
        "blur2view triage frames --csv triage.csv --keep frames/keep.txt",
        "blur2view triage flight --gsd 2cm --csv flight.csv",
        "blur2view triage frames --keep-for-poses poses.txt --keep-for-training train.txt",
        "colmap feature_extractor --image_path frames --image_list_path frames/keep.txt --database_path a.db",
    )

    def __post_init__(self) -> None:
        choice = self.choice
        if choice.selects and choice.keep is None and choice.extract is None:
            raise ValueError("--best and --every-best choose what --keep LIST names or --extract DIR holds")
        self.rates.check(self.lens)
        self.resuming.check(self.table.csv, *choice.lists.values(), choice.extract)
        self.many.check(self.lens)

    @staticmethod
    def tables() -> dict[str, str | Mapping[str, str]]:
        """Return what --help-all lists besides options."""
        return {"uses": USES, "columns of --csv": explanations(flat=True), "what is written": LIST}

    def execute(self) -> int:
        """Return the exit code, after looking at every photograph and writing table, lists and pictures.

        A run that was ended early extracts nothing, and chooses nothing of neighbours.
        """
        photographs, choice, lists = Photographs.of("triage", self), self.choice, self.choice.lists
        inputs = photographs.inputs
        names = dict(zip(inputs.sources, inputs.names(), strict=True))
        files = extracted_names(names)
        jobs = photographs.jobs()
        jobs = [replace(job, refusal=job.refusal or unlistable(job)) if lists else job for job in jobs]
        targets = {"--extract": (choice.extract, "")} | {name: (path, "list") for name, path in lists.items()}
        with photographs.opened(targets) as earlier:
            self._check_folder(inputs.sources, files.values())
            show = partial(use_line, limit_px=self.sharp.longest.number, verbose=self.printing.verbose)
            finished = photographs.run(
                jobs,
                partial(look_at, photographs.setup),
                earlier,
                classify=self.sharp.classifier(),
                show=show,
                total=False,
            )
            rows = {job.source: one.photograph for job, one in finished.outcomes if not is_folder(job)}
            if finished.end is not End.BROKEN and rows:
                self._write(finished, rows, names, files)
        return finished.exit_code

    def _write(
        self,
        finished: Finished,
        rows: Mapping[Source, Photograph],
        names: Mapping[Source, str],
        files: Mapping[Source, str],
    ) -> None:
        """Write lists and pictures, and print the closing line."""
        choice, whole = self.choice, finished.end is End.WHOLE
        with waiting("choosing photographs"):
            kept = choice.selected(rows)
        pictures = {one: files[one] for one in kept}
        if whole:
            self._check_folder(rows, pictures.values())
        written = {
            name: path for name, path in choice.lists.items() if name in KEPT or whole or not choice.selects
        }
        for name, target in written.items():
            chosen = kept
            if name in KEPT:
                chosen = [one for one, row in rows.items() if row.use in KEPT[name]]
            text = "".join(f"{names[one]}\n" for one in chosen)
            write_file(target, text.encode("utf-8", "surrogateescape"), sealed=True)
        if choice.extract is not None and whole:
            with waiting(f"writing {len(pictures)} pictures"):
                extract(choice.extract, pictures)
        if not self.printing.quiet:
            words = f"{len(kept)} kept" if kept else f"none is kept: {self._remedy}"
            words *= choice.keep is not None or choice.extract is not None
            table = self.table.csv if finished.has_table else None
            made = table, *written.values(), choice.extract if kept and whole else None
            print(
                closing_line(
                    finished, rows.values(), words, choice.lists, [one for one in made if one is not None]
                )
            )

    @property
    def _remedy(self) -> str:
        """What would keep photographs where none is kept."""
        limits = f"--max-smear is {self.sharp.longest}, --max-defocus {self.sharp.max_defocus:g}"
        return f"{limits}; --blurred keeps the blurred ones that are of use, --best 50% the sharper half"

    def _check_folder(self, sources: Iterable[Source], files: Collection[str]) -> None:
        """Refuse a folder for the pictures that holds others than these, or what the call reads or writes."""
        folder = self.choice.extract
        if folder is not None:
            here = {os.path.realpath(one.path.parent) for one in sources}
            if os.path.realpath(folder) in here:
                raise OutputError(f"{folder}: holds the photographs themselves; name an empty folder")
            besides = [one for one in (self.table.csv, *self.choice.lists.values()) if one is not None]
            refuse_others(folder, files, [*besides, *folder.glob(f".*{ENDING}"), folder / SUMS])


def look_at(setup: Setup, job: Job) -> Outcome:
    """Return the record of one photograph, which is looked at less closely."""
    one = setup.estimated(job, detail=Detail.RANKING)
    return Outcome(photograph=setup.record(one, job), warnings=one.warnings)


def use_line(job: Job, outcome: Outcome, *, limit_px: float, verbose: bool) -> str:
    """Return one line about a photograph, on demand with what its blur means."""
    one = outcome.photograph
    text = f"{printable(str(job.source))}: {one.use} ({_length(one, limit_px)})"
    return f"{text}: {one.verdict}" if verbose else text


def _length(one: Photograph, limit_px: float) -> str:
    """Return how long the blur is, near the limit with a digit more."""
    if one.smear_px is None or one.use == Use.UNCLEAR:
        return "no texture"
    if one.use == Use.OUT_OF_FOCUS:
        return f"by a radius of {one.defocus_px or 0.0:.1f} px"
    if one.use == Use.SHARP and one.smear_px >= limit_px * NEAR:
        return "no motion of the camera"  # by its kind: the length is below its own deviation
    near = limit_px / NEAR < one.smear_px < limit_px * NEAR
    digits = 2 if near else 1 if one.smear_px < 9.95 else 0
    ground = "" if one.smear_ground_m is None else f", {values.ground_text(one.smear_ground_m)} on the ground"
    return f"smears of {one.smear_px:.{digits}f} px{ground}"


def closing_line(
    finished: Finished,
    rows: Collection[Photograph],
    kept: str,
    lists: Collection[str],
    written: Sequence[Path],
) -> str:
    """Return how many photographs are of which use, ``kept`` how many are, and what was written.

    ``lists`` are the names of those that were asked for.
    """
    counts = Counter(row.use for row in rows)
    uses = [f"{counts[use]} {words}" for use, words in COUNTED.items()]
    uses += [f"{counts[use]} {words}" for use, words in COUNTED_IF_ANY.items() if counts[use]]
    parts = [", ".join(uses), *([kept] if kept else [])]
    for name in (name for name in KEPT if name in lists and not any(counts[use] for use in KEPT[name])):
        parts.append(f"{name} names none, as none is {' or '.join(KEPT[name])}")
    files = " and ".join(printable(str(path)) for path in written)
    parts += [f"wrote {files}"] * bool(files)
    before = f" ({finished.skipped} done before)" * bool(finished.skipped)
    return f"{plural(len(rows), 'photograph')}{before} in {finished.seconds:.1f} s: {'; '.join(parts)}"


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
