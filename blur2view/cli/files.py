"""Commands that write files of each photograph beside each other: which, when, and what they hold."""

import io
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from blur2view.arrays import AnyArray
from blur2view.cli.photographs import Files, Photographs
from blur2view.cli.terminal import printable
from blur2view.errors import OutputError
from blur2view.exposure.gyroflow import gyroflow_log
from blur2view.images.inputs import Inputs
from blur2view.output_files import SIGNED_BY, check_file, real_paths, write_file
from blur2view.results.photograph import Photograph
from blur2view.runs.job import Job, Outcome, Work

# Pictures are for looking at: the fastest deflate takes two thirds of the time of 3 of 9, for 5 % more bytes.
_PNG_EFFORT = 1
FAILURES = {"failures": "(list) Photographs that failed: image, error."}


@dataclass(frozen=True, kw_only=True)
class Folder:
    """output.

    -o, --output DIR: write files of each photograph, see below, into DIR, in place of those of an earlier
        call
    --json: print one JSON document instead of the summaries, see below
    Rarely:
    --jsonl: instead print the JSON document of each photograph on one line as soon as it is done, in their
        order; of one that fails image and error
    """

    effect, either = False, ("json", "jsonl")
    output: Path | None = None
    json: bool = False
    jsonl: bool = False


def run_into_folder(
    photographs: Photographs,
    work: Work,
    folder: Folder,
    *,
    listed: str,
    endings: Sequence[str],
    beside: Callable[[Path], Sequence[Path]] = lambda name: (),
    log: Path | None = None,
) -> int:
    """Return the exit code, after the work on every photograph, which has files if a folder is named.

    They are called by the photograph's stem and these ``endings``, in the order of writing, JSON last;
    ``beside`` gives further files of a photograph by its name, below the folder, which are written first.
    With --json the documents are printed as a list of this name; a ``log`` of their rates is Gyroflow's.
    """
    output, printed = folder.output, folder.json or folder.jsonl
    plan = [] if output is None else list(_plan(photographs.inputs, output, endings, beside))
    paths = [path for files in plan for path in files]
    folders = [] if output is None else [output, *sorted({path.parent for path in paths})]
    targets = {"--gyroflow": (log, "log")}
    with photographs.opened(targets, *folders, taken=paths, journal=output is None) as earlier:
        jobs = photographs.jobs(list(_refused(photographs.inputs, plan)))
        show = partial(_shown, folder)
        keeps = folder.json or log is not None
        finished = photographs.run(jobs, work, earlier, show=show, keeps=keeps, total=not printed)
        if log is not None:
            records = [one.photograph for _, one in finished.outcomes if not one.error]
            write_file(log, gyroflow_of(records, photographs.inputs).encode(), sealed=True)
    if folder.json:
        done = [one.photograph.plain() for _, one in finished.outcomes if not one.error]
        print(json.dumps({listed: done, "failures": finished.failures}, indent=2, allow_nan=False))
    return finished.exit_code


def gyroflow_of(records: Sequence[Photograph], inputs: Inputs) -> str:
    """Return Gyroflow's log of the frames of a video whose rates and direction of time are known.

    OutputError without any.
    """
    known = [
        (one.timestamp_s, [(1 if one.gyroscope else -1) * rate for rate in (one.wx, one.wy, one.wz)])
        for one in records
        if one.time_known and one.exposure_s and one.timestamp_s is not None
        if one.wx is not None and one.wy is not None and one.wz is not None
    ]
    if not known:
        raise OutputError(
            "no frame has a time, a rate and a known direction of time; name a video, --focal and --exposure"
        )
    video = inputs.sources[0].path.name if inputs.one_video else ""
    return gyroflow_log([time for time, _ in known], np.array([rate for _, rate in known]), video)


def _shown(folder: Folder, job: Job, outcome: Outcome) -> str | None:
    """Return what is printed of a photograph; with --jsonl its document is."""
    if folder.jsonl:
        failed = {"image": str(job.source), "error": outcome.error}
        document = failed if outcome.error else outcome.photograph.plain()
        print(json.dumps(document, allow_nan=False), flush=True)
    return None if folder.json or folder.jsonl else outcome.summary


def _plan(
    inputs: Inputs, folder: Path, endings: Sequence[str], beside: Callable[[Path], Sequence[Path]]
) -> Iterator[Files]:
    """Yield the files of each photograph."""
    for name, below in zip(inputs.result_names(), inputs.own_names(), strict=True):
        own = (Path(f"{name}{ending}") for ending in endings)
        yield tuple(folder / path for path in (*beside(below), *own))


def _refused(inputs: Inputs, plan: Sequence[Files]) -> Iterator[Files | OutputError]:
    """Yield the files of each photograph, or why they must not be written.

    Inputs and files of other programs are never replaced, nor results of another photograph of the call.
    """
    read, first_of = real_paths([*(one.path for one in inputs.sources), *inputs.lists]), dict[Path, object]()
    for source, files in zip(inputs.sources, plan, strict=bool(plan)):
        other = next((first_of[path] for path in files if path in first_of), None)
        first_of |= dict.fromkeys(files, source)
        try:
            if other is not None:
                raise OutputError(f"its results would be those of {other}; use another -o")
            for path in files:
                check_file(path, "result", read)
            yield files
        except OutputError as error:
            yield OutputError(f"{source}: {error}")


def wrote(job: Job, endings: Sequence[str]) -> str:
    """Return what a summary says of a photograph's files, if it has some."""
    if not job.files:
        return ""
    name = printable(str(job.files[-1]).removesuffix(endings[-1]))
    return f"; wrote {name}.{{{','.join(ending.removeprefix('.') for ending in reversed(endings))}}}"


def png(picture: AnyArray) -> bytes:
    """Return a picture as a PNG that says who wrote it, which `output_files.is_ours` looks for."""
    text, stream = PngInfo(), io.BytesIO()
    text.add_text("Software", SIGNED_BY)
    Image.fromarray(picture).save(stream, "PNG", compress_level=_PNG_EFFORT, pnginfo=text)
    return stream.getvalue()
