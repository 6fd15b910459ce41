"""Files of results: planned before any work, each written whole or not at all."""

import os
import tempfile
from collections import Counter
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from blur2view.errors import OutputError
from blur2view.file_writing import half_written, is_there, unwritable, write_files
from blur2view.input_files import open_regular, parse_json, read_regular

SIGNED_BY = "blur2view"  # the PNG text "Software"
# What results hold: a key of JSON documents, the first array of an NPZ file, PNG's text, the report's tag,
# the head of a table
SIGNS = {
    ".json": (b'"model_id":', b'"generator": "blur2view '),
    ".npz": (b"smear_grid.npy", b"displacement.npy"),
    ".png": (b"Software\0" + SIGNED_BY.encode(),),
    ".html": (b'name="generator" content="blur2view ',),
    ".ply": (f"comment {SIGNED_BY}\n".encode(),),
    ".csv": (b"name,verdict,parallax,smear_px,",),
}
# of one file, whatever it is called
KINDS = {"page": ".html", "table": ".csv", "file": ".json", "point cloud": ".ply"}
MAX_NAME = 255  # bytes of a file's or a folder's name, on Linux, macOS and (of ASCII) Windows
MAX_DOCUMENT = 1 << 26  # bytes; that of a photograph has some thousands


def check_file(target: Path, what: str, inputs: Iterable[Path] = (), *, option: str = "-o") -> None:
    """Refuse, before any work, to write one file where it would replace what is not of an earlier call.

    ``what`` it is, as of `KINDS`, and the ``option`` that names it are for the message. OutputError if it is
    one of the ``inputs``, a folder, or a file of another kind.
    """
    if os.path.realpath(target) in {os.path.realpath(path) for path in inputs}:
        raise OutputError(f"{target}: the {what} would replace a photograph; name another with {option}")
    if target.is_dir():
        raise OutputError(f"{target}: is a folder; name the {what} with {option}")
    if os.path.lexists(target) and not is_ours(target, KINDS.get(what)):
        raise OutputError(
            f"{target}: is no {what} of an earlier call; name another with {option} or remove it"
        )


@contextmanager
def prepared(*folders: Path | None) -> Iterator[None]:
    """Create folders that can be written, which is tried; at the end remove those in which nothing lies.

    OutputError if one cannot be created or written.
    """
    created: set[Path] = set()
    try:
        for folder in filter(None, folders):
            try:
                created |= {path for path in (folder, *folder.parents) if not path.exists()}
                folder.mkdir(parents=True, exist_ok=True)
                with tempfile.TemporaryFile(dir=folder):  # of a name that no other process uses
                    pass
            except OSError as error:
                raise unwritable(folder, error) from None
        yield
    finally:
        for folder in sorted(created, reverse=True):
            with suppress(OSError):
                folder.rmdir()


@contextmanager
def writing(folder: Path) -> Iterator[None]:
    """Create a folder, see `prepared`, for what is written; OutputError where it cannot be."""
    with prepared(folder):
        try:
            yield
        except OSError as error:
            raise unwritable(folder, error) from None


@dataclass(frozen=True, kw_only=True)
class ResultFiles:
    """The files of one photograph, of which the last one, a document, is written last: then all are there."""

    folder: Path
    stem: str  # the photograph's name without its suffix
    endings: tuple[str, ...]  # what follows it, such as ".json", in the order of writing
    beside: Path | None = None  # a file with a name of its own, written first

    @property
    def paths(self) -> tuple[Path, ...]:
        """All of them, in the order of writing."""
        named = tuple(self.folder / f"{self.stem}{ending}" for ending in self.endings)
        return named if self.beside is None else (self.beside, *named)

    @property
    def document(self) -> Path:
        """The JSON document."""
        return self.paths[-1]


class Earlier(Protocol):
    """What is written down of the results of earlier calls."""

    def knows_file(self, path: Path) -> bool:
        """Return whether a file is a result of an earlier call, of whichever photograph."""

    def other_owner(self, path: Path, outputs: Iterable[Path]) -> str | None:
        """Return the other photograph of which one of these files is a result."""


def plan_outputs(
    images: Sequence[Path],
    folder: Path,
    endings: Sequence[str],
    *,
    overwrite: bool = False,
    names: Mapping[Path, Path] | None = None,
    beside: Callable[[Path], Path] | None = None,
    earlier: Earlier | None = None,
) -> list[ResultFiles | OutputError]:
    """Return the files of each photograph of a call, in this folder, or why they must not be written.

    Photographs of one stem get subfolders as they have, or else keep their suffix; ``names`` are what results
    are called where that is known. With ``overwrite`` results of other photographs may be replaced, too;
    photographs and files of others never are. ``beside`` maps the name of a photograph to that of a further
    file, below the folder. ``earlier`` alone tells apart photographs of one name that were named from
    different folders.
    """
    inputs = {os.path.realpath(image) for image in images}
    first_of: dict[Path, Path] = {}
    plan: list[ResultFiles | OutputError] = []
    for image, name in zip(images, result_names(images, names or {}), strict=True):
        further = None if beside is None else folder / beside((names or {}).get(image, Path(image.name)))
        files = ResultFiles(
            folder=folder / name.parent, stem=name.name, endings=tuple(endings), beside=further
        )
        other = next((first_of[path] for path in files.paths if path in first_of), None)
        first_of |= dict.fromkeys(files.paths, image)
        refusal = _refusal(files.paths, inputs)
        if refusal is None and not overwrite:
            refusal = _refusal_by_owner(files, image, earlier)
        if other is not None:
            refusal = f"its results would replace those of {other}; use another -o"
        plan.append(files if refusal is None else OutputError(f"{image}: {refusal}"))
    return plan


def _refusal(paths: Sequence[Path], inputs: Container[str]) -> str | None:
    """Return why files must not be written whatever photograph they are of, if so."""
    # file systems take no longer part of a path, or of it half written
    if any(
        len(part.encode(errors="replace")) > MAX_NAME for path in paths for part in half_written(path).parts
    ):
        return "the names of its results would be too long; rename it or the folder that it is in"
    foreign = [path for path in paths if os.path.lexists(path) and not is_ours(path)]
    hit = [path for path in paths if os.path.realpath(path) in inputs]
    if hit:
        return f"a result would replace the photograph {hit[0]}; use another -o"
    if foreign:
        return f"{foreign[0]} is no result of an earlier call; use another -o or remove it"
    return None


def _refusal_by_owner(files: ResultFiles, image: Path, earlier: Earlier | None) -> str | None:
    """Return why files are of another photograph, which a call from another folder may have named."""
    named, document = _image_of(files.document), files.document
    if named is not None and os.path.realpath(named) != os.path.realpath(image):
        below = "/".join(part for part in Path(named).parts if part != "..")
        may_be = Path(os.path.abspath(image)).as_posix().endswith(f"/{below}")
        if not may_be or earlier is None or not earlier.knows_file(document):
            return f"{document} is the result of {named}; use another -o or add --overwrite"
    other = None if earlier is None else earlier.other_owner(image, files.paths)
    return other and f"its results would replace those of {other}; use another -o or add --overwrite"


def _image_of(document: Path) -> str | None:
    """Return the photograph that a document is of; None if it is not there or damaged."""
    try:
        content = parse_json(read_regular(document, MAX_DOCUMENT))
        image = content.get("image") if isinstance(content, dict) else None
        return image if isinstance(image, str) else None
    except (OSError, ValueError):
        return None


def is_ours(path: Path, kind: str | None = None) -> bool:
    """Return whether a file says that blur2view wrote it; pictures of 0.1.0 do not.

    ``kind`` is the suffix that stands for what it should be; its own by default.
    """
    signs = SIGNS.get(kind or path.suffix.lower(), ())
    with suppress(OSError), open_regular(path) as file:
        start = file.read(1 << 20)
        return any(sign in start for sign in signs)
    return False


def result_names(images: Sequence[Path], known: Mapping[Path, Path]) -> list[Path]:
    """Return each photograph's known name or stem; where two have one its subfolder, suffix if need be."""
    below = [Path(*(part for part in path.parts if part != "..")) for path in below_shared_folder(images)]
    short = [known.get(image, Path(image.stem)) for image in images]
    distinct = dict(zip(map(os.path.abspath, images), zip(short, below, strict=True), strict=True)).values()
    shorts = Counter(name for name, _ in distinct)
    wholes = Counter(path.parent / path.stem for _, path in distinct)
    names = []
    for name, path in zip(short, below, strict=True):
        whole = path.parent / path.stem
        names.append(name if shorts[name] == 1 else whole if wholes[whole] == 1 else path)
    return names


def below_shared_folder(paths: Sequence[Path]) -> list[Path]:
    """Return paths below the folder that all files share; one at which there is none changes no other's."""
    absolute = [os.path.abspath(path) for path in paths]
    there = [path for path in absolute if is_there(path)] or absolute
    folder = os.path.commonpath([os.path.dirname(path) for path in there])
    return [Path(os.path.relpath(path, folder)) for path in absolute]


def write_text(target: Path, text: str) -> None:
    """Write a table or a list, whole or not at all."""
    with writing(target.parent):
        write_files({target: text.encode("utf-8", "surrogateescape")})
