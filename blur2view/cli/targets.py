"""Where ``blur2view to-colmap`` writes: a fresh database, one of the user's, or a folder of text or HDF5."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from blur2view.batch.manifest import Manifest
from blur2view.cli.options import ToColmapOptions
from blur2view.cli.run import manifest_beside
from blur2view.cli.views import PhotographViews
from blur2view.colmap import hloc_files, text_formats
from blur2view.colmap.database import refuse_changed, refuse_existing, stored_photographs, write_database
from blur2view.colmap.link import write_links
from blur2view.errors import DatabaseError
from blur2view.exposure.views import OPEN
from blur2view.input_files import read_regular

SQLITE_FILES = ("-journal", "-wal", "-shm")  # beside a database that is written


@dataclass(frozen=True, kw_only=True)
class ViewsTarget(ABC):
    """What all photographs are written to at once.

    Parameters
    ----------
    path : Path
        The database, or the folder.
    """

    path: Path
    is_new = False
    """Whether it is a file that a manifest tells from one that was changed since."""

    @property
    def manifest(self) -> Path:
        """Where is written down what is done."""
        return manifest_beside(self.path)

    @property
    def files(self) -> Sequence[Path]:
        """What is written besides, or in the folder."""
        return [Path(f"{self.path}{end}") for end in SQLITE_FILES]

    def checked(self, manifest: Manifest | None, *, resume: bool) -> ViewsTarget:
        """Return the target, after refusing before any work what must not be written."""
        return self

    def photographs(self) -> set[str]:
        """Return those whose views an earlier call has written, which this one would write anew."""
        return set()

    @abstractmethod
    def write(self, made: Sequence[PhotographViews]) -> Path | None:
        """Write all views; return the backup, if there is one."""


@dataclass(frozen=True, kw_only=True)
class FreshDatabase(ViewsTarget):
    """A database that appears whole or not at all; a call that goes on replaces that of an earlier one."""

    replaces: bool = False
    is_new = True

    def checked(self, manifest: Manifest | None, *, resume: bool) -> FreshDatabase:
        """Return whether the file is replaced; DatabaseError if there is one that must not be."""
        if manifest is not None and manifest.wrote(self.path):
            if resume:
                return replace(self, replaces=True)
            raise DatabaseError(
                f"{self.path}: is of an earlier call; add --resume to go on, or choose another --db"
            )
        if manifest is not None and manifest.has_target(self.path):
            refuse_changed(self.path)
        refuse_existing(self.path)
        return self

    def photographs(self) -> set[str]:
        """Return those whose views it holds."""
        return stored_photographs(self.path) if self.path.exists() else set()

    def write(self, made: Sequence[PhotographViews]) -> None:
        """Write the database, if there is anything to write."""
        if made:
            write_database(self.path, [one.views for one in made], replace=self.replaces)


@dataclass(frozen=True, kw_only=True)
class LinkedDatabase(ViewsTarget):
    """A database of the user's that views are added to, after a copy of it."""

    backup: bool

    def write(self, made: Sequence[PhotographViews]) -> Path | None:
        """Add the views in one transaction."""
        return write_links(self.path, [one.job for one in made], backup=self.backup)


@dataclass(frozen=True, kw_only=True)
class ViewsFolder(ViewsTarget):
    """A folder of text files for COLMAP, or of hloc's."""

    command: str
    hloc: bool

    @property
    def manifest(self) -> Path:
        """Where is written down what is done."""
        return manifest_beside(self.path / self.command)

    @property
    def files(self) -> Sequence[Path]:
        """What is written in the folder."""
        return [self.path / name for name in (hloc_files if self.hloc else text_formats).NAMES]

    def checked(self, manifest: Manifest | None, *, resume: bool) -> ViewsFolder:
        """Return the folder; OutputError if it holds more than views."""
        (hloc_files if self.hloc else text_formats).refuse_foreign(self.path)
        return self

    def photographs(self) -> set[str]:
        """Return those whose views are there: those of hloc's pairs, or of the matches."""
        path = self.files[-1 if self.hloc else 0]
        words = read_regular(path).decode("utf-8", "replace").split() if path.exists() else []
        return {word.removesuffix(OPEN) for word in words if word.endswith(OPEN)}

    def write(self, made: Sequence[PhotographViews]) -> None:
        """Write the files."""
        views = [one.views for one in made]
        if self.hloc:
            hloc_files.write_hloc(self.path, views)
        else:
            text_formats.write_matches_text(self.path, views, [one.photograph.path for one in made])


def target_of(options: ToColmapOptions) -> ViewsTarget:
    """Return what the options name."""
    if options.link:
        return LinkedDatabase(path=options.target, backup=options.backup)
    if options.db is not None:
        return FreshDatabase(path=options.db)
    return ViewsFolder(path=options.target, command=options.command, hloc=options.hloc)
