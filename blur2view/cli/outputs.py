"""Commands that write files of each photograph beside each other: which, when, and what they hold."""

import io
import json
import os
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from PIL import Image
from PIL.PngImagePlugin import PngInfo

from blur2view.arrays import AnyArray
from blur2view.cli.arguments.option import option
from blur2view.cli.arguments.shared import PhotographOptions
from blur2view.cli.run import Files, jobs_of, open_manifest, run_over
from blur2view.cli.terminal import printable
from blur2view.cli.work import outcome_of
from blur2view.errors import OutputError
from blur2view.images.inputs import Inputs
from blur2view.output_files import SIGNED_BY, below_shared_folder, check_file, real_paths, writable_folders
from blur2view.pipeline import FileEstimate
from blur2view.results.document import Document
from blur2view.runs.job import Job, Outcome
from blur2view.runs.manifest import ENDING, Manifest

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

    @property
    def manifest_path(self) -> Path | None:
        """The hidden manifest in the folder of the results, else that of the table."""
        return self.output / f".{self.command}{ENDING}" if self.output else super().manifest_path

    def execute(self) -> int:
        """Return the exit code, after the work on every photograph, which has files of its own, with -o."""
        plan = [] if self.output is None else list(self._plan(self.output))
        paths = [path for files in plan for path in files]
        with (
            writable_folders(self.output, *sorted({path.parent for path in paths})),
            open_manifest(self, paths) as manifest,
        ):
            finished = run_over(self, jobs_of(self, list(self._refused(plan, manifest))), manifest)
        if self.json:
            done = [one.payload for _, one in finished.outcomes if not one.error]
            document = {self.listed: done, "failures": finished.failures}
            print(json.dumps(document, indent=2, allow_nan=False))
        return finished.exit_code

    def _plan(self, folder: Path) -> Iterator[Files]:
        """Yield the files of each photograph."""
        for name, image in zip(result_names(self.inputs), self.inputs.paths, strict=True):
            beside = self.beside(self.inputs.names.get(image, Path(image.name)))
            yield tuple(folder / path for path in (*beside, *(Path(f"{name}{end}") for end in self.endings)))

    def ending(self, job: Job) -> str:
        """Return what a summary says of a photograph's files, if it has some."""
        if not job.files:
            return ""
        name = str(job.files[-1]).removesuffix(self.endings[-1])
        endings = ",".join(ending.removeprefix(".") for ending in reversed(self.endings))
        return f"; wrote {printable(name)}.{{{endings}}}"

    def _refused(self, plan: Sequence[Files], manifest: Manifest | None) -> Iterator[Files | OutputError]:
        """Yield the files of each photograph, or why they must not be written.

        Photographs and files of others are never replaced; results of another photograph, of which a manifest
        says so, are with --overwrite.
        """
        photographs, first_of = real_paths(self.inputs.paths), dict[Path, Path]()
        for image, files in zip(self.inputs.paths, plan, strict=bool(plan)):
            other: object = next((first_of[path] for path in files if path in first_of), None)
            remedy = ""
            first_of |= dict.fromkeys(files, image)
            if other is None and manifest is not None and not self.overwrite:
                other, remedy = manifest.other_owner(image, files), " or add --overwrite"
            try:
                for path in files:
                    check_file(path, "result", photographs)
                if other is not None:
                    raise OutputError(f"its results would replace those of {other}; use another -o{remedy}")
                yield files
            except OutputError as error:
                yield OutputError(f"{image}: {error}")


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
    if job.files:
        written = [*contents(), (document.to_json() + "\n").encode()]
        files = dict(zip(job.files, written, strict=True))
    return outcome_of(one, document.plain(), summary, files)


def png(picture: AnyArray) -> bytes:
    """Return a picture as a PNG that says who wrote it, which `output_files.is_ours` looks for."""
    text, stream = PngInfo(), io.BytesIO()
    text.add_text("Software", SIGNED_BY)
    Image.fromarray(picture).save(stream, "PNG", compress_level=_PNG_EFFORT, pnginfo=text)
    return stream.getvalue()
