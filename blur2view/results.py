"""Results on disk and on the terminal: JSON, arrays, overlay and a readable summary."""

import json
import os
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, Protocol, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.cameras import Camera
from blur2view.errors import OutputError
from blur2view.intrinsics import Intrinsics
from blur2view.matches import SelectOptions
from blur2view.pipeline import Estimate
from blur2view.two_view import EstimatorOptions, TwoViewGeometry
from blur2view.viz import draw_overlay

POSE_KEYS = ("E", "cam2_from_cam1", "rotation_deg", "angular_velocity_rad_s", "pose_covariance", "exposure_s")

# The overlay is for looking at: fast deflate (3 of 9) is a third of the time of the best.
_PNG_EFFORT = [cv2.IMWRITE_PNG_COMPRESSION, 3]


@dataclass(frozen=True, kw_only=True)
class OutputFiles:
    """The three files of one photograph.

    Parameters
    ----------
    folder : Path
        Where they lie.
    stem : str
        The photograph's name without its suffix.
    """

    folder: Path
    stem: str

    @property
    def document(self) -> Path:
        """``<stem>.json``."""
        return self.folder / f"{self.stem}.json"

    @property
    def arrays(self) -> Path:
        """``<stem>.smear.npz``."""
        return self.folder / f"{self.stem}.smear.npz"

    @property
    def picture(self) -> Path:
        """``<stem>.png``."""
        return self.folder / f"{self.stem}.png"

    @property
    def paths(self) -> tuple[Path, Path, Path]:
        """All three, in the order of writing: the document last, so that it marks completeness."""
        return self.arrays, self.picture, self.document


@dataclass(frozen=True, kw_only=True)
class Run:
    """What was asked for, the same for every photograph of a call."""

    select: SelectOptions
    options: EstimatorOptions
    seed: int
    intrinsics: Intrinsics = field(default_factory=Intrinsics)
    exposure_s: float | None = None


def prepare_folder(folder: Path) -> None:
    """Create the folder if needed and prove that files can be written there.

    Raises
    ------
    OutputError
        If it cannot be created or written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):  # of a name that no other process uses
            pass
    except OSError as error:
        raise unwritable(folder, error) from None


Files = TypeVar("Files", bound="ResultFiles", covariant=True)


class ResultFiles(Protocol):
    """The files of one photograph."""

    @property
    def paths(self) -> tuple[Path, ...]:
        """All of them, in the order of writing."""


class ResultKind(Protocol[Files]):
    """Names the files of one photograph, as the class :class:`OutputFiles` does."""

    def __call__(self, *, folder: Path, stem: str) -> Files:
        """Give those of a photograph's name without its suffix."""


def plan_outputs(
    images: Sequence[Path], folder: Path, *, overwrite: bool, kind: ResultKind[Files]
) -> list[Files | OutputError]:
    """Name the files of each photograph, or say why they must not be written.

    Parameters
    ----------
    images : sequence of Path
        The photographs of one call.
    folder : Path
        Where the files go.
    overwrite : bool
        Whether files of an earlier call may be replaced. Photographs of this call never are.
    kind : ResultKind
        What a photograph's files are, such as :class:`OutputFiles`.

    Returns
    -------
    list of Files or OutputError
        One per photograph. A second photograph of the same stem is refused, so that no result is lost.
    """
    inputs = {os.path.realpath(image) for image in images}
    first_of: dict[str, Path] = {}
    plan: list[Files | OutputError] = []
    for image in images:
        files = kind(folder=folder, stem=image.stem)
        taken = [path for path in files.paths if os.path.lexists(path)]
        hit = [path for path in files.paths if os.path.realpath(path) in inputs]
        if image.stem in first_of:
            other = first_of[image.stem]
            plan.append(OutputError(f"{image}: its results would replace those of {other}; use another -o"))
            continue
        first_of[image.stem] = image
        if hit:
            plan.append(
                OutputError(f"{image}: a result would replace the photograph {hit[0]}; use another -o")
            )
        elif taken and not overwrite:
            plan.append(OutputError(f"{image}: {taken[0]} exists; use another -o or add --overwrite"))
        else:
            plan.append(files)
    return plan


def document(
    image: Path,
    size: tuple[int, int],
    estimate: Estimate,
    run: Run,
    read_s: float,
    exposure_s: float | None = None,
) -> dict[str, Any]:
    """Return the JSON document of one photograph.

    Parameters
    ----------
    image : Path
        As the user named it.
    size : tuple of int
        Height and width in pixels, after EXIF rotation.
    estimate : Estimate
        What was found.
    run : Run
        What was asked for.
    read_s : float
        Seconds spent on decoding.
    exposure_s : float, optional
        Exposure time in seconds.

    Returns
    -------
    dict
        Plain JSON types; the keys are part of the stable surface, and the README lists them.
    """
    geometry = estimate.geometry
    return {
        "image": str(image),
        "width": size[1],
        "height": size[0],
        "F": None if geometry.F is None else geometry.F.tolist(),
        "H": None if geometry.H is None else geometry.H.tolist(),
        "config": geometry.config.name,
        "reason": geometry.reason,
        "motion_model": geometry.model,
        "scores": dict(geometry.scores),
        "support": geometry.support,
        **camera_facts(estimate.camera),
        **pose_facts(geometry, exposure_s),
        "num_matches": len(estimate.matches),
        "num_inliers": int(np.count_nonzero(geometry.inlier_mask)),
        "iterations": geometry.iterations,
        "beta": run.select.beta,
        "max_error_px": run.options.max_error_px,
        "seed": run.seed,
        "model_id": estimate.model_id,
        "timings_s": {"read": read_s}
        | {k.removesuffix("_s"): v for k, v in asdict(estimate.timings).items()},
    }


def camera_facts(camera: Camera | None) -> dict[str, Any]:
    """Return the intrinsics that were used, for the JSON document."""
    if camera is None:
        return {"K": None, "camera": None}
    said = {"model": camera.model, "params": list(camera.params), "source": camera.source}
    return {"K": camera.K.tolist(), "camera": said | {"known": camera.known}}


def pose_facts(geometry: TwoViewGeometry, exposure_s: float | None) -> dict[str, Any]:
    """Return E, the pose, its covariance and its rates, for the JSON document; null where there are none."""
    pose, covariance = geometry.cam2_from_cam1, geometry.covariance
    facts: dict[str, Any] = dict.fromkeys(POSE_KEYS)
    facts["exposure_s"] = exposure_s
    if pose is None:
        return facts
    facts["cam2_from_cam1"] = {"rotation": pose.rotation.tolist(), "translation": pose.translation.tolist()}
    facts["rotation_deg"] = pose.angle_deg
    if geometry.E is not None:
        facts["E"] = geometry.E.tolist()
    if exposure_s is not None:
        facts["angular_velocity_rad_s"] = (pose.rotation_vector / exposure_s).tolist()
    if covariance is not None:
        facts["pose_covariance"] = {
            "matrix": covariance.matrix.tolist(),
            "tangents": covariance.tangents.tolist(),
            "rotation_sigma_deg": covariance.rotation_sigma_deg.tolist(),
            "translation_sigma_deg": covariance.translation_sigma_deg,
        }
    return facts


def write_results(
    files: OutputFiles, facts: dict[str, Any], image: NDArray[np.float32], estimate: Estimate
) -> None:
    """Write the arrays, the overlay and the document, each whole or not at all.

    Parameters
    ----------
    files : OutputFiles
        Where.
    facts : dict
        From :func:`document`.
    image : ndarray of shape (H, W, 3), float32
        The photograph.
    estimate : Estimate
        What was found.

    Raises
    ------
    OutputError
        If a file cannot be written.
    """
    geometry, field = estimate.geometry, estimate.field
    picture = draw_overlay(image, field, estimate.matches, geometry)
    encoded = cv2.imencode(".png", picture[..., ::-1], _PNG_EFFORT)[1].tobytes()
    text = json.dumps(facts, indent=2, allow_nan=False) + "\n"
    told: Any = {} if field.sigma_rad is None else {"sigma_rad": field.sigma_rad}
    try:
        files.document.unlink(missing_ok=True)  # an older one must not vouch for new arrays if we are killed
        write_atomically(
            files.arrays,
            # compressed it takes 40 times as long (0.63 s at 1280x720) and is an eighth smaller
            lambda file: np.savez(
                file,
                displacement=field.displacement,
                sigma_px=field.sigma_px,
                **told,
                inlier_mask=geometry.inlier_mask,
                swapped=geometry.swapped,
                ends=estimate.matches.ends,
                match_sigma_px=estimate.matches.weighed_across().sigma_px,
            ),
        )
        write_atomically(files.picture, lambda file: file.write(encoded))
        write_atomically(files.document, lambda file: file.write(text.encode()))
    except OSError as error:
        raise unwritable(files.folder, error) from None


def write_atomically(path: Path, write: Callable[[BinaryIO], object]) -> None:
    """Write beside the path and rename, so that a reader never meets half a file.

    Raises
    ------
    OSError
        If the file cannot be written; nothing is left behind then.
    """
    beside = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with beside.open("wb") as file:
            write(file)
        beside.replace(path)
    finally:
        beside.unlink(missing_ok=True)


def unwritable(folder: Path, error: OSError) -> OutputError:
    """Return the one line about a folder that takes no files."""
    reason = error.strerror or type(error).__name__
    return OutputError(f"{folder}: results cannot be written there ({reason}); choose another folder with -o")
