"""``blur2view triage``: which photographs are sharp, and which blurred ones are of use; options and work."""

import os
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import ClassVar

from blur2view.arrays import Array
from blur2view.cli.arguments.option import Rows, option
from blur2view.cli.arguments.shared import PhotographOptions
from blur2view.cli.arguments.values import METRES, PERCENT, Amount, best, metres, radius, smear
from blur2view.cli.run import LISTS, End, jobs_of, open_manifest, run_over
from blur2view.cli.uses import BLURRED, KEPT, SHARP, Classifier, closing_line, use_line
from blur2view.cli.work import estimated, outcome_of
from blur2view.errors import Blur2ViewError, OutputError
from blur2view.images.image import read_image
from blur2view.images.inputs import colmap_names
from blur2view.images.selection import (
    extract,
    extracted_names,
    refuse_others,
    sharpest,
    sharpest_of_each,
    thumbnail,
)
from blur2view.networks.protocol import Detail
from blur2view.output_files import write_file
from blur2view.results.table import Row
from blur2view.results.verdicts import verdict_of
from blur2view.runs.job import Job, Outcome
from blur2view.runs.manifest import ENDING

MAX_SMEAR = Amount(number=3.0)
"""Longest median smear, pixels, of a photograph that is called sharp: at most this, half of the SIFT features
that a photograph shares with itself under fresh noise are still matched (``python -m
tools.benchmarks.triage``; chosen on the photographs of Kodak's suite that train networks, shown on the
others)."""
ONE_SAMPLE = Amount(number=1.0)
"""That of an aerial photograph: one ground sample (photogrammetry asks for less than one)."""
MAX_DEFOCUS = 2.0
"""Largest radius out of focus, pixels, of a photograph that is called sharp."""
USES = """
sharp: the median of all smears of the picture is at most --max-smear, and the radius out of focus of what
    is in focus, if anything is, at most --max-defocus; kept
blurred: it is longer, but F or H explains the smears, so that the views of the exposure are of use (blur2view
    to-colmap); kept with --blurred only
unusable: it is longer, and no geometry explains it (DEGENERATE, UNDEFINED); kept by --best and --every-best
    only
out of focus: the lens, not a motion, blurs all of it; kept as unusable ones
unclear: nothing shows texture, or it is too dark: perhaps sharp; kept as unusable ones
near the limit: within a tenth of it a frame is sharp if the one before it in its video is
the same photographs of another size: give the limit in per cent of the diagonal. Frames that were compressed
    much again have shorter smears than those of their video; --extract compresses nothing
"""
LIST = """
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
"""


@dataclass(frozen=True, kw_only=True)
class TriageOptions(PhotographOptions):
    """The options of ``blur2view triage``.

    Look at every photograph and say what blurred it, motion or a lens out of focus, and by how much: a table
    of all, and a list, or a folder, of those to use. Each is sharp; blurred but of use, where geometry
    explains its smears; unusable, where nothing does; out of focus; or unclear, where it is too smooth or too
    dark to show blur, which the variance of the Laplacian would confuse.
    """

    command = "triage"
    keep: Path | None = option(None, "LIST")
    "write the list of photographs to keep, see below"
    keep_for_poses: Path | None = option(None, "LIST", rare=True)
    "write a list of the sharp ones and the blurred ones of use"
    keep_for_training: Path | None = option(None, "LIST", rare=True)
    "write a list of the sharp ones"
    extract: Path | None = option(None, "DIR")
    "write the photographs to keep into a folder, frames of videos as PNG, see below"
    max_smear: Amount | None = option(None, "PX", convert=smear, usual=MAX_SMEAR)
    """the longest median of a sharp photograph, in pixels, as 0.3%% of the picture's diagonal, or with --gsd
    as 3cm (default: %(usual)s, up to which half of its SIFT features are still matched; with
    --gsd 1, a ground sample)"""
    gsd: float | None = option(None, "LENGTH", convert=metres)
    """the ground sample distance, as 2cm, of aerial photographs: sharp are those whose smear is within one"""
    max_defocus: float = option(MAX_DEFOCUS, "PX", convert=radius)
    "the largest radius out of focus of a sharp photograph, in pixels (default: %(default)s)"
    blurred: bool = option(False, either="choice")
    "keep the blurred ones, too, that geometry can use"
    best: Amount | None = option(None, "N", convert=best, either="choice")
    "keep the N sharpest, or as 50%%, by the width of all of the blur"
    every_best: int | None = option(None, "N", either="choice")
    "keep the sharpest of every N neighbours, and of each view among them"
    in_order: bool = option(False, names="--sequence")
    """the photographs of a folder are the frames of a video: near the limit each is as sharp as the one
    before"""
    overwrite: bool = option(False, rare=True)
    """replace a list that was changed since it was written, too, if it names nothing but these
    photographs"""
    sequence: bool | None = False

    tables: ClassVar[dict[str, Rows]] = {"uses": USES, "columns of --csv": Row, "the list": LIST}
    examples = (
        "blur2view triage clip.mp4 --every-best 6 --extract frames",
        "blur2view triage frames --csv triage.csv --keep frames/keep.txt",
        "blur2view triage flight --gsd 2cm --csv flight.csv",
        "blur2view triage frames --keep-for-poses poses.txt --keep-for-training train.txt",
        "colmap feature_extractor --image_path frames --image_list_path frames/keep.txt --database_path a.db",
    )

    def __post_init__(self) -> None:
        if self.resume and self.csv is None and not self.lists and self.extract is None:
            raise ValueError("--resume goes on with what --csv, --keep or --extract names; add one")
        if self.max_smear is not None and self.max_smear.unit == METRES and self.gsd is None:
            raise ValueError("--max-smear on the ground needs --gsd, what a pixel shows, as 2cm")
        if self.selects and self.keep is None and self.extract is None:
            raise ValueError("--best and --every-best choose what --keep LIST names or --extract DIR holds")
        super().__post_init__()

    @property
    def limit(self) -> Amount:
        """The longest median smear of a sharp photograph."""
        return self.max_smear or (MAX_SMEAR if self.gsd is None else ONE_SAMPLE)

    @property
    def lists(self) -> dict[str, Path]:
        """The lists of the call, by their options."""
        named = {name: getattr(self, name.removeprefix("--").replace("-", "_")) for name in LISTS}
        return {name: path for name, path in named.items() if path is not None}

    @property
    def targets(self) -> dict[str, Path]:
        """The lists, the folder of pictures and the table."""
        folder = {} if self.extract is None else {"--extract": self.extract}
        return self.lists | folder | super().targets

    @property
    def selects(self) -> bool:
        """Whether photographs are kept by their order of blur, whatever they are of use for."""
        return self.best is not None or self.every_best is not None

    def __call__(self, job: Job) -> Outcome:
        """Return the row of one photograph."""
        one = estimated(self, job, detail=Detail.RANKING)
        return outcome_of(one, None, verdict_of(one))

    def execute(self) -> int:
        """Return the exit code, after looking at every photograph and writing table, lists and pictures.

        A run that was ended early extracts nothing, and chooses nothing of neighbours.
        """
        lists, names = self.lists, colmap_names(self.inputs)
        files = extracted_names(names)
        jobs = [replace(job, refusal=unlistable(job)) if lists else job for job in jobs_of(self)]
        with open_manifest(self) as manifest:
            self._check_folder(files.values())
            classify = Classifier(self.limit, self.max_defocus, self.gsd, in_order=self.in_order)
            line = partial(use_line, limit_px=self.limit.number, meaning=self.verbose)
            finished = run_over(self, jobs, manifest, classify=classify, line=line)
            if finished.end is End.BROKEN or not finished.rows:
                return finished.exit_code
            paths = [one for one, _ in finished.outcomes if not self.inputs.is_folder(one)]
            of = dict(zip(paths, finished.rows, strict=True))
            kept = [paths[index] for index in sorted(self._selected(paths, finished.rows))]
            whole, pictures = finished.end is End.WHOLE, {one: files[one] for one in kept}
            if whole:
                self._check_folder(pictures.values())
            written = {name: lists[name] for name in lists if name in KEPT or whole or not self.selects}
            for name, target in written.items():
                chosen = [one for one in of if of[one].use in KEPT[name]] if name in KEPT else kept
                text = "".join(f"{names[one]}\n" for one in chosen)
                write_file(target, text.encode("utf-8", "surrogateescape"))
                if manifest is not None:
                    manifest.append_target(target)
            if self.extract is not None and whole:
                extract(self.extract, pictures)
        if not self.quiet:
            words = f"{len(kept)} kept" if kept else f"none is kept: {self._remedy}"
            words *= self.keep is not None or self.extract is not None
            made = self.csv if finished.has_table else None, *written.values()
            made = *made, self.extract if kept and whole else None
            print(closing_line(finished, words, list(lists), [one for one in made if one is not None]))
        return finished.exit_code

    @property
    def _remedy(self) -> str:
        """What would keep photographs where none is kept."""
        limits = f"--max-smear is {self.limit}, --max-defocus {self.max_defocus:g}"
        return f"{limits}; --blurred keeps the blurred ones that are of use, --best 50% the sharper half"

    def _selected(self, paths: Sequence[Path], rows: Sequence[Row]) -> set[int]:
        """Return the indices of the photographs to keep."""
        read = [index for index, row in enumerate(rows) if not row.error]
        lengths = [rows[index].width_px for index in read]
        if self.best is not None:
            number, percent = self.best.number, self.best.unit == PERCENT
            chosen = sharpest(lengths, max(round(len(read) * number / 100), 1) if percent else int(number))
        elif self.every_best is not None:
            series = [paths[index].parent for index in read]
            chosen = sharpest_of_each(lengths, series, self.every_best, lambda one: view(paths[read[one]]))
        else:
            wanted = (SHARP, BLURRED) if self.blurred else (SHARP,)
            return {index for index in read if rows[index].use in wanted}
        return {read[index] for index in chosen}

    def _check_folder(self, files: Collection[str]) -> None:
        """Refuse a folder for the pictures that holds others than these, or what the call reads or writes."""
        if self.extract is not None:
            here = {os.path.realpath(path.parent) for path in self.inputs.paths}
            if os.path.realpath(self.extract) in here:
                raise OutputError(f"{self.extract}: holds the photographs themselves; name an empty folder")
            besides = [one for one in (self.csv, *self.lists.values()) if one is not None]
            refuse_others(self.extract, files, [*besides, *self.extract.glob(f".*{ENDING}")])


def view(path: Path) -> Array | None:
    """Return the thumbnail of a photograph, None of one that cannot be read any more."""
    try:
        return thumbnail(read_image(path))
    except Blur2ViewError:
        return None


def unlistable(job: Job) -> OutputError | None:
    """Return why COLMAP's list of images, one name a line, cannot hold a photograph, if so."""
    if job.name.splitlines() == [job.name.strip()]:
        return None
    why = "has a line break in its name, or a blank at its end, which no list holds; rename it"
    return OutputError(f"{job.path}: {why}")
