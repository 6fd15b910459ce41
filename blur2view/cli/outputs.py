"""Commands that write files of each photograph beside each other: which, when, and what they hold."""

import io
import json
import os
from collections import Counter
from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from blur2view.arrays import AnyArray
from blur2view.cli.arguments.option import option
from blur2view.cli.arguments.shared import PhotographOptions
from blur2view.cli.run import jobs_of, manifest_of, open_manifest, refuse_shared, run_over
from blur2view.cli.work import outcome_of
from blur2view.errors import OutputError
from blur2view.output_files import (
    SIGNED_BY,
    ResultFiles,
    below_shared_folder,
    is_ours,
    remove_left_over,
    writable_folders,
)
from blur2view.photographs.inputs import Inputs
from blur2view.pipeline import FileEstimate
from blur2view.results.document import Document
from blur2view.results.overlay import draw_overlay
from blur2view.runs.job import Job, Outcome
from blur2view.runs.manifest import ENDING, Manifest
from blur2view.smears.stored import stored_smears

# Pictures are for looking at: the fastest deflate takes two thirds of the time of 3 of 9, for 5 % more bytes.
_PNG_EFFORT = 1


MANIFEST = """
.<command>.manifest.jsonl: the hidden manifest, JSON lines: what --resume goes on
    with
"""
FAILURES = {"failures": "(list) Photographs that failed: image, error."}


@dataclass(frozen=True, kw_only=True)
class FolderOptions(PhotographOptions):
    """Those of a command that writes files of each photograph into a folder, if one is named."""

    listed: ClassVar[str]  # what the documents are called in the one that --json prints
    endings: ClassVar[Sequence[str]]  # of a photograph's files, behind its stem, in the order of writing

    output: Path | None
    overwrite: bool = option(False, rare=True)
    "replace results of other photographs, too (those of an earlier call of the same are anyway)"
    json: bool = option(False, either="printed")
    "print one JSON document instead of the summaries, see below"
    jsonl: bool = option(False, either="printed", rare=True)
    """instead print the JSON document of each photograph on one line as soon as it is done, in their order;
    of one that fails image and error"""

    def __post_init__(self) -> None:
        if self.resume and self.output is None:
            raise ValueError("--resume goes on with results in a folder; name it with -o")
        super().__post_init__()

    def beside(self, photograph: Path) -> tuple[Path, ...]:
        """Return further files of a photograph of this name, below the folder, which are written first."""
        return ()

    @property
    def keeps(self) -> bool:  # type: ignore[override]
        """Whether the documents are printed at the end."""
        return self.json

    def execute(self) -> int:
        """Return the exit code, after the work on every photograph, which has files of its own, with -o."""
        folder = self.output
        path = manifest_of(self, self.csv) if folder is None else folder / f".{self.command}{ENDING}"
        with writable_folders(folder), open_manifest(self, path, [folder]) as manifest:
            jobs = jobs_of(self, [] if folder is None else self._planned(folder, manifest))
            paths = {path for job in jobs if job.files for path in job.files.paths}
            if self.csv is not None:
                refuse_shared(self, self.csv, paths, "--csv")
            folders = sorted({path.parent for path in paths})
            with writable_folders(*folders):
                finished = run_over(self, jobs, manifest)
                remove_left_over(paths, folders)  # of a call that was killed
        if self.json:
            done = [one.payload for _, one in finished.outcomes if not one.error]
            document = {self.listed: done, "failures": finished.failures}
            print(json.dumps(document, indent=2, allow_nan=False))
        return finished.exit_code

    def _planned(self, folder: Path, manifest: Manifest | None) -> list[ResultFiles | OutputError]:
        """Return the files of each photograph, or why they must not be written.

        Photographs and files of others are never replaced; results of another photograph, of which a manifest
        says so, are with --overwrite.
        """
        inputs, owners = self.inputs, None if self.overwrite else manifest
        photographs = {os.path.realpath(image) for image in inputs.paths}
        first_of: dict[Path, Path] = {}
        plan: list[ResultFiles | OutputError] = []
        for image, name in zip(inputs.paths, result_names(inputs), strict=True):
            beside = self.beside(inputs.names.get(image, Path(image.name)))
            files = ResultFiles(
                folder=folder / name.parent,
                stem=name.name,
                endings=tuple(self.endings),
                beside=tuple(folder / path for path in beside),
            )
            other = next((first_of[path] for path in files.paths if path in first_of), None)
            first_of |= dict.fromkeys(files.paths, image)
            refusal = _refusal(files.paths, photographs)
            if other is not None:
                refusal = f"its results would replace those of {other}; use another -o"
            elif refusal is None and owners is not None and (of := owners.other_owner(image, files.paths)):
                refusal = f"its results would replace those of {of}; use another -o or add --overwrite"
            plan.append(files if refusal is None else OutputError(f"{image}: {refusal}"))
        return plan


def _refusal(paths: Sequence[Path], inputs: Container[str]) -> str | None:
    """Return why files must not be written whatever photograph they are of, if so."""
    foreign = [path for path in paths if os.path.lexists(path) and not is_ours(path)]
    hit = [path for path in paths if os.path.realpath(path) in inputs]
    if hit:
        return f"a result would replace the photograph {hit[0]}; use another -o"
    if foreign:
        return f"{foreign[0]} is no result of an earlier call; use another -o or remove it"
    return None


def result_names(inputs: Inputs) -> list[Path]:
    """Return each photograph's known name or stem; where two have one its subfolder, suffix if need be."""
    images, known = inputs.paths, inputs.names
    below = [Path(*(part for part in path.parts if part != "..")) for path in below_shared_folder(images)]
    short = [known.get(image, Path(_stem(image))) for image in images]
    distinct = dict(zip(map(os.path.abspath, images), zip(short, below, strict=True), strict=True)).values()
    shorts = Counter(name for name, _ in distinct)
    wholes = Counter(path.parent / _stem(path) for _, path in distinct)
    names = []
    for name, path in zip(short, below, strict=True):
        whole = path.parent / _stem(path)
        names.append(name if shorts[name] == 1 else whole if wholes[whole] == 1 else path)
    return names


def _stem(path: Path) -> str:
    """Return a file's name without its suffix, that of ..jpg whole."""
    return path.stem if path.stem.strip(".") else path.name


def with_files(
    job: Job, one: FileEstimate, document: Document, summary: str, contents: Callable[[], list[bytes]]
) -> Outcome:
    """Return what is made of a photograph, its document the last of its files, if it has some."""
    files = {}
    if job.files is not None:
        written = [*contents(), (document.to_json() + "\n").encode()]
        files = dict(zip(job.files.paths, written, strict=True))
    return outcome_of(one, document.plain(), summary, files)


def estimate_contents(one: FileEstimate, *, full_field: bool = False) -> list[bytes]:
    """Return the arrays and the overlay of a photograph.

    With ``full_field`` the smears of all pixels, which take much, instead of the network's grid.
    """
    found, geometry, matches, arrays = one.estimate, one.estimate.geometry, one.estimate.matches, io.BytesIO()
    np.savez(
        arrays,
        **stored_smears(found.grid, full_field=full_field),  # type: ignore[arg-type]
        ends=matches.ends,
        match_sigma_px=matches.sampson_px,
        inlier_mask=geometry.inlier_mask,
        swapped=geometry.swapped,
    )
    picture = draw_overlay(one.image, found.grid, matches, geometry, one.run.exposure_s, found.blur)
    return [arrays.getvalue(), png(picture)]


def png(picture: AnyArray) -> bytes:
    """Return a picture as a PNG that says who wrote it, which `output_files.is_ours` looks for."""
    text, stream = PngInfo(), io.BytesIO()
    text.add_text("Software", SIGNED_BY)
    Image.fromarray(picture).save(stream, "PNG", compress_level=_PNG_EFFORT, pnginfo=text)
    return stream.getvalue()
