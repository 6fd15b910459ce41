"""The options of each command, frozen and checked: what argparse gives becomes one of these at once."""

from __future__ import annotations

import math
import sys
from argparse import Namespace
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from blur2view.cli.terminal import QUIET
from blur2view.errors import CameraError

if TYPE_CHECKING:
    from blur2view.photographs.inputs import Inputs
    from blur2view.pipeline import Run

Options = TypeVar("Options")
SHORTEST_S = 1e-9  # no shutter and no flash is as short


@dataclass(frozen=True, kw_only=True)
class PhotographOptions:
    """What the commands over photographs share: the options of ``--help-all`` by their names.

    ``inputs`` are the photographs, ``run`` is how each is estimated.
    """

    command: str
    inputs: Inputs
    run: Run
    model: str | None
    csv: Path | None
    resume: bool
    overwrite: bool = False
    jobs: int | None
    dask: str | None
    max_failures: int | None
    verbosity: int
    json: bool = False
    jsonl: bool = False
    sequence: bool | None = False
    timings: bool = True

    def __post_init__(self) -> None:
        if self.dask is not None and callable(self.run.intrinsics.camera):
            raise ValueError(
                "the workers of --dask see no database; write its camera out: MODEL WIDTH HEIGHT ..."
            )

    @property
    def prints(self) -> bool:
        """Whether a line is printed for each photograph, and a total."""
        return not (self.json or self.jsonl) and self.verbosity > QUIET


@dataclass(frozen=True, kw_only=True)
class FolderOptions(PhotographOptions):
    """Those of a command that writes files of each photograph into a folder, if one is named."""

    output: Path | None

    def __post_init__(self) -> None:
        if self.json and self.jsonl:
            raise ValueError("--json prints one document at the end, --jsonl one for each; choose")
        if self.resume and self.output is None:
            raise ValueError("--resume goes on with results in a folder; name it with -o")
        super().__post_init__()


@dataclass(frozen=True, kw_only=True)
class EstimateOptions(FolderOptions):
    """Those of ``blur2view estimate``."""

    full_field: bool


@dataclass(frozen=True, kw_only=True)
class SegmentCommandOptions(FolderOptions):
    """Those of ``blur2view segment``."""

    masks: str | None
    unobservable: str

    def __post_init__(self) -> None:
        if self.masks is not None and self.output is None:
            raise ValueError("--masks needs a folder; name it with -o")
        super().__post_init__()


@dataclass(frozen=True, kw_only=True)
class ReportOptions(PhotographOptions):
    """Those of ``blur2view report``."""

    output: Path
    mask: bool


@dataclass(frozen=True, kw_only=True)
class Amount:
    """A number, or a percentage of what is known later."""

    number: float
    percent: bool = False

    def __str__(self) -> str:
        return f"{self.number:g}{'%' if self.percent else ''}"


@dataclass(frozen=True, kw_only=True)
class TriageOptions(PhotographOptions):
    """Those of ``blur2view triage``."""

    keep: Path | None
    extract: Path | None
    max_smear: Amount
    max_defocus: float
    blurred: bool
    best: Amount | None
    every_best: int | None
    in_order: bool

    def __post_init__(self) -> None:
        if self.resume and self.csv is None and self.keep is None and self.extract is None:
            raise ValueError("--resume goes on with what --csv, --keep or --extract names; add one")
        if self.selects and self.keep is None and self.extract is None:
            raise ValueError("--best and --every-best choose what --keep LIST names or --extract DIR holds")
        super().__post_init__()

    @property
    def selects(self) -> bool:
        """Whether photographs are kept by their order of blur, whatever they are of use for."""
        return self.best is not None or self.every_best is not None


@dataclass(frozen=True, kw_only=True)
class ToColmapOptions(PhotographOptions):
    """Those of ``blur2view to-colmap``."""

    db: Path
    link: bool
    replace: bool
    backup: bool
    dry_run: bool
    skip_movers: bool

    def __post_init__(self) -> None:
        if not self.link and (self.replace or self.skip_movers or not self.backup):
            raise ValueError("--replace, --skip-movers and --no-backup go with --link")
        if self.link and self.dask is not None:
            raise ValueError("--link goes without --dask, whose workers see no database")
        super().__post_init__()

    @property
    def prints(self) -> bool:
        """Whether a line is printed for each photograph while they are gone through: all are at the end."""
        return False

    @property
    def in_order(self) -> bool | None:
        """Whether neighbours show which view came first; None: those whose names say so."""
        return True if self.sequence is None and self.inputs.one_video else self.sequence


def read_options(parsed: Namespace, kind: type[Options]) -> Options:
    """Return what argparse gave as options of a kind; a wrong value is a usage error."""
    values = dict(vars(parsed))
    try:
        if issubclass(kind, PhotographOptions):
            values |= {"run": _run(values), "inputs": _inputs(values)}
        known = {field.name for field in fields(kind)}  # type: ignore[arg-type]
        return kind(**{name: value for name, value in values.items() if name in known})
    except (ValueError, CameraError) as error:
        parsed.usage_error(str(error))
        raise


def _inputs(values: Mapping[str, Any]) -> Inputs:
    from blur2view.photographs.inputs import list_photographs
    from blur2view.photographs.video import frame_numbers

    frames = partial(frame_numbers, every=values["every"], first=values["first"], last=values["last"])
    stdin = None if sys.stdin is None else sys.stdin.buffer
    return list_photographs(values["images"], recursive=values["recursive"], frames=frames, stdin=stdin)


def _run(values: Mapping[str, Any]) -> Run:
    from blur2view.camera.intrinsics import Intrinsics
    from blur2view.colmap.cameras import stored_camera
    from blur2view.geometry.rolling_shutter import RollingShutter
    from blur2view.pipeline import Run
    from blur2view.smears.selection import SelectOptions
    from blur2view.two_view.options import EstimatorOptions

    exposure_s, readout_s = values.get("exposure"), values.get("readout")
    stated = values["focal"] is not None or values["camera"] is not None
    if values["seed"] < 0:
        raise ValueError(f"seed must not be negative, got {values['seed']}")
    if exposure_s is not None and not SHORTEST_S < exposure_s < math.inf:
        raise ValueError(f"exposure must be above {SHORTEST_S:g} s and finite, got {exposure_s}")
    if readout_s is not None and not stated:
        raise ValueError("--readout corrects the pose of --focal or --camera only; add one")
    if exposure_s is not None and not stated:
        raise ValueError("--exposure gives an angular velocity with --focal or --camera only; add one")
    if readout_s is not None:
        RollingShutter(readout_s=readout_s, exposure_s=exposure_s or 1.0)  # which checks it
    camera = stored_camera(values["camera"] or "") or values["camera"]
    return Run(
        select=SelectOptions(beta=values["beta"]),
        options=EstimatorOptions(max_error_px=values["max_error"]),
        seed=values["seed"],
        intrinsics=Intrinsics(focal_px=values["focal"], camera=camera),
        exposure_s=exposure_s,
        readout_s=readout_s,
        max_memory_gib=values["max_memory"],
    )
