"""Commands that write files of each photograph beside each other: which, when, and what they hold."""

import io
import os
from collections import Counter
from collections.abc import Callable, Container, Sequence
from pathlib import Path

import numpy as np
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from blur2view.arrays import AnyArray
from blur2view.cli.arguments.shared import FolderOptions
from blur2view.cli.run import jobs_of, manifest_of, open_manifest, refuse_shared, run_over
from blur2view.cli.work import Written
from blur2view.errors import OutputError
from blur2view.output_files import (
    SIGNED_BY,
    ResultFiles,
    below_shared_folder,
    half_written,
    is_ours,
    remove_left_over,
    writable_folders,
)
from blur2view.photographs.inputs import Inputs
from blur2view.pipeline import FileEstimate
from blur2view.results.document import Document, FailureDocument
from blur2view.results.estimate import EstimateDocument
from blur2view.results.mask_overlay import draw_motion
from blur2view.results.masks import MaskDocument
from blur2view.results.overlay import draw_overlay
from blur2view.runs.job import Work
from blur2view.segmentation.formats import GREY
from blur2view.segmentation.mask import MotionMask
from blur2view.smears.stored import stored_smears

# Pictures are for looking at: the fastest deflate takes two thirds of the time of 3 of 9, for 5 % more bytes.
_PNG_EFFORT = 1


ESTIMATE = (".smear.npz", ".png", ".json")
MASK = (".mask.png", ".moving.png", ".motion.png", ".motion.json")
"""What the files of a photograph are called after its stem, in the order of writing."""
MASKS = Path("masks")
"""Folder below -o in which masks for another program lie."""
MAX_NAME = 255  # bytes of a file's or a folder's name, on Linux, macOS and (of ASCII) Windows
MAX_PATH = 4095  # bytes of a whole path, on Linux
MANIFEST = ".manifest.jsonl"


def run_with_files(
    options: FolderOptions,
    endings: Sequence[str],
    work: Work[ResultFiles | None, Written | None],
    collect: Callable[[list[Written], list[FailureDocument]], Document],
    beside: Callable[[Path], Path] | None = None,
) -> int:
    """Return the exit code, after the work on every photograph, which has files of its own, with -o.

    With ``--json`` the one document of ``collect`` is printed at the end, with ``--jsonl`` that of each
    photograph. ``beside`` is as of `plan_outputs`.
    """
    folder = options.output
    path = manifest_of(options, options.csv) if folder is None else folder / f".{options.command}{MANIFEST}"
    others = [] if folder is None else sorted({*folder.glob(f".*{MANIFEST}")} - {path})
    with writable_folders(folder), open_manifest(options, work, path, [folder], others) as manifest:
        plan: Sequence[ResultFiles | OutputError] = ()
        if folder is not None:
            owner = None if manifest is None or options.overwrite else manifest.other_owner
            plan = plan_outputs(options.inputs, folder, endings, beside=beside, owner=owner)
        jobs = jobs_of(options, plan)
        paths = {path for job in jobs if job.target for path in job.target.paths}
        refuse_shared(options, options.csv, paths, "--csv")
        folders = sorted({path.parent for path in paths})
        with writable_folders(*folders):
            finished = run_over(options, work, jobs, manifest)
            if options.resume:  # at the end: workers of a killed call live on for a moment
                remove_left_over(paths, folders)
    if options.json:
        print(collect([one for one in finished.payloads if one is not None], finished.failures).to_json())
    return finished.exit_code


def plan_outputs(
    inputs: Inputs,
    folder: Path,
    endings: Sequence[str],
    *,
    beside: Callable[[Path], Path] | None = None,
    owner: Callable[[Path, Sequence[Path]], str | None] | None = None,
) -> list[ResultFiles | OutputError]:
    """Return the files of each photograph of a call, or why they must not be written.

    Photographs and files of others are never replaced; results of another photograph are unless ``owner``,
    which looks them up in a manifest, says which. ``beside`` maps the name of a photograph to that of a
    further file, below the folder.
    """
    photographs = {os.path.realpath(image) for image in inputs.paths}
    first_of: dict[Path, Path] = {}
    plan: list[ResultFiles | OutputError] = []
    for image, name in zip(inputs.paths, result_names(inputs), strict=True):
        further = None if beside is None else folder / beside(inputs.names.get(image, Path(image.name)))
        files = ResultFiles(
            folder=folder / name.parent, stem=name.name, endings=tuple(endings), beside=further
        )
        other = next((first_of[path] for path in files.paths if path in first_of), None)
        first_of |= dict.fromkeys(files.paths, image)
        refusal = _refusal(files.paths, photographs)
        if refusal is None and owner is not None and (of := owner(image, files.paths)):
            refusal = f"its results would replace those of {of}; use another -o or add --overwrite"
        if other is not None:
            refusal = f"its results would replace those of {other}; use another -o"
        plan.append(files if refusal is None else OutputError(f"{image}: {refusal}"))
    return plan


def _refusal(paths: Sequence[Path], inputs: Container[str]) -> str | None:
    """Return why files must not be written whatever photograph they are of, if so."""
    written = [half_written(path).absolute() for path in paths]
    parts = [part for path in written for part in path.parts]
    if max(map(_bytes, parts)) > MAX_NAME or max(map(_bytes, map(str, written))) > MAX_PATH:
        return "the names of its results would be too long; rename it or the folder that it is in"
    foreign = [path for path in paths if os.path.lexists(path) and not is_ours(path)]
    hit = [path for path in paths if os.path.realpath(path) in inputs]
    if hit:
        return f"a result would replace the photograph {hit[0]}; use another -o"
    if foreign:
        return f"{foreign[0]} is no result of an earlier call; use another -o or remove it"
    return None


def _bytes(name: str) -> int:
    return len(name.encode(errors="replace"))


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


def result_contents(
    files: ResultFiles, document: EstimateDocument, one: FileEstimate, *, full_field: bool = False
) -> dict[Path, bytes]:
    """Return what is written for a photograph: the arrays, the overlay and the document.

    With ``full_field`` the smears of all pixels, which take much, instead of the network's grid.
    """
    geometry, matches, grid = one.estimate.geometry, one.estimate.matches, one.estimate.grid
    picture = draw_overlay(one.image, grid, matches, geometry, one.run.exposure_s, one.estimate.blur)
    arrays = io.BytesIO()
    np.savez(
        arrays,
        **stored_smears(grid, full_field=full_field),  # type: ignore[arg-type]
        ends=matches.ends,
        match_sigma_px=matches.sampson_px,
        inlier_mask=geometry.inlier_mask,
        swapped=geometry.swapped,
    )
    contents = arrays.getvalue(), png(picture), (document.to_json() + "\n").encode()
    return dict(zip(files.paths, contents, strict=True))


def mask_contents(
    files: ResultFiles, document: MaskDocument, image: AnyArray, mask: MotionMask, further: Sequence[AnyArray]
) -> dict[Path, bytes]:
    """Return what is written for a photograph: further pictures, mask, probabilities, overlay, document."""
    levels = np.round(255 * mask.probability).astype(np.uint8)
    contents = (
        *map(png, (*further, GREY[mask.labels], levels, draw_motion(image, mask))),
        (document.to_json() + "\n").encode(),
    )
    return dict(zip(files.paths, contents, strict=True))


def png(picture: AnyArray) -> bytes:
    """Return a picture as a PNG that says who wrote it, which `output_files.is_ours` looks for."""
    text, stream = PngInfo(), io.BytesIO()
    text.add_text("Software", SIGNED_BY)
    Image.fromarray(picture).save(stream, "PNG", compress_level=_PNG_EFFORT, pnginfo=text)
    return stream.getvalue()
