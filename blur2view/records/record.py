"""The record of a photograph: the keys of its JSON and the columns of the tables of --csv.

JSON is the record itself, a row of CSV its flat part, ``--help-all`` the explanations of its fields and
properties. A property follows from fields: it is written, and never read back.
"""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterable, Iterator
from dataclasses import MISSING, dataclass, field, fields, replace
from enum import StrEnum
from typing import Any, Protocol, Self

from blur2view.geometry.configuration import MotionModel
from blur2view.records.verdict import decide_use, verdict
from blur2view.smears.blur import CAMERA_KINDS
from blur2view.two_view.constants import TRANSLATION_RULE

Matrix = list[list[float]]
ALONG_SMEAR = math.sqrt(3)
"""Length of the smear that spreads as widely, along itself, as a disc of radius 1 does."""
LOOK = (
    *("name", "error", "use", "verdict", "blur", "blur_px", "smear_px", "defocus_px"),
    *("smear_percent", "smear_sigma_px", "direction_deg", "defocus_sigma_px", "camera_moved", "moving_share"),
    *("nothing_seen", "width", "height", "frame", "timestamp_s", "exposure_s"),
    *("beta", "max_error_px", "seed", "version", "input_sha256", "options_sha256"),
)
"""Columns of the table of triage, which looks too briefly to fill others: those of other commands follow."""
FAILED = "name", "error", "verdict"
"""Columns that the row of a photograph that failed fills."""
FLAT = "str", "int", "float", "bool"
"""Types of what a table holds."""
TYPES = {
    **{kind.__name__: kind for kind in (str, int, bool, list, dict)},
    "float": int | float,
    "Matrix": list,
    "None": type(None),
}
"""What JSON holds of a field, by the first word of its type."""
FORMULA = "=", "+", "-", "@", "\t", "\r"  # how names begin that a spreadsheet takes for formulas


def explained(text: str, default: Any = None, *, geometry: bool = False) -> Any:
    """Return a field of the record with its explanation, required if ``default`` is `MISSING`.

    ``geometry`` marks what only a close look gives: triage leaves it empty.
    """
    return field(default=default, metadata={"help": " ".join(text.split()), "geometry": geometry})


def geometric(text: str, default: Any = None) -> Any:
    """Return a field of the geometry with its explanation."""
    return explained(text, default, geometry=True)


class Recorded(Protocol):
    """What states its record: `blur2view.pipeline.Estimate`."""

    def record(self, *, name: str, **stated: Any) -> Record:
        """Return the record under a name, with fields that are stated beside it."""


@dataclass(frozen=True, kw_only=True)
class Record:
    """The record of one photograph; null, or in a table empty, where there is no such value.

    Matrices are lists of rows. Points are (x, y) in pixels of the upright photograph with (0, 0) at the
    centre of the top-left one; only the ``params`` of a camera follow COLMAP: that centre is (0.5, 0.5).
    """

    name: str = explained("Path below the folder that was given, or that all photographs share.", MISSING)
    error: str = explained(
        "Why the photograph failed, which is its verdict, too; everything else is then empty.", ""
    )
    width: int | None = explained("Width of the upright photograph in pixels.")
    height: int | None = explained("Height of the upright photograph in pixels.")
    frame: int | None = explained("Number of the frame in its video, counted from 0.")
    timestamp_s: float | None = explained("Time in seconds, from the video or the file name.")

    blur: str = explained(
        """Kind of blur: sharp, out of focus, camera moved, camera at rest (and something moves), out of focus
        and moved, or cannot tell. A geometry is looked for only if the camera moved.""",
        "",
    )
    camera_moved: float | None = explained("Probability that the camera moved; null if it cannot be told.")
    nothing_seen: str = explained(
        """Why the blur cannot be told: too dark, overexposed, one colour, or smears no longer than their
        errors.""",
        "",
    )
    smear_px: float | None = explained(
        "Median length of the smears in pixels, weighted by how well they show."
    )
    smear_sigma_px: float | None = explained(
        "Standard deviation of smear_px; a shorter smear may be an error."
    )
    direction_deg: float | None = explained(
        "Direction of the smears, from x to y, 0 to 180; null if it varies."
    )
    defocus_px: float | None = explained(
        """Radius in pixels of the disc to which the lens spreads a point, where the picture is in best focus:
        1 or less if that is sharp."""
    )
    defocus_sigma_px: float | None = explained("Standard deviation of this radius in pixels.")
    moving_share: float | None = explained(
        """Part of the picture, 0 to 1, that moves by itself, as people and cars do; null if nobody looked:
        segment always looks, other commands where it is in doubt whether the camera moved."""
    )
    use: str = explained(
        "Use of the photograph: sharp, blurred (and explained by a geometry, if one was looked for), out of "
        "focus, unclear or unusable.",
        "",
    )

    K: Matrix | None = explained("Calibration matrix; (0, 0) is the centre of the top-left pixel.")
    camera: dict[str, Any] | None = explained("Camera as COLMAP writes it: model, params, source, known.")
    config: str = geometric(
        """Configuration, a name of COLMAP's TwoViewGeometryConfiguration. triage leaves it and all geometry
        empty, because it looks less closely.""",
        "",
    )
    reason: str = geometric("Sentence with the figures that decided on the configuration.", "")
    parallax: str = geometric(
        """Whether the smears show different depths: proven (UNCALIBRATED, CALIBRATED), undecided (F may fit
        errors only, or too little is seen) or absent (H alone, or no motion).""",
        "",
    )
    models: list[Any] | None = geometric(
        "Models compared, likeliest first: model, parameters, log_likelihood, probability."
    )
    independent_smears: float = geometric("Number of independent smears of the same weight in all.", 0.0)
    F: Matrix | None = geometric(
        """Fundamental matrix with points2^T F points1 = 0 and Frobenius norm 1; 1 is shutter-open and 2 is
        shutter-close, or the reverse: F and its transpose are one answer. If the lens distorts, F, H and E
        hold for undistorted pixels."""
    )
    H: Matrix | None = geometric("Homography, points2 ~ H points1; if F is given too, parallax is undecided.")
    num_matches: int | None = geometric("Number of smears that were used.")
    num_inliers: int | None = geometric(
        """Number of smears that fit: the Sampson distance of their ends, in the better of both orders, is
        below 1.73 px and a tenth of their length, or below two of their own standard deviations."""
    )
    support_by_chance: float | None = geometric("Share of the smears that would fit by chance.")
    num_trials: int | None = geometric("Samples that the robust search for F drew, as COLMAP counts them.")
    inlier_ratio: float | None = geometric("Share of the smears that followed the best F of that search.")
    E: Matrix | None = geometric("Essential matrix, if the intrinsics are known.")
    cam2_from_cam1: dict[str, Any] | None = geometric(
        f"""Pose, if the intrinsics are known: rotation (3x3) and translation (unit length or zero); the
        inverse pose is the same answer. The translation is {TRANSLATION_RULE}; the rotation is then the one
        that explains the smears alone, or the mean over all directions."""
    )
    pose_covariance: dict[str, Any] | None = geometric(
        """Covariance of the pose: matrix (5x5: rotation vector in radians, direction of the translation along
        two tangents), tangents, rotation_sigma_deg, translation_sigma_deg (43 for an unknown direction)."""
    )
    wx: float | None = geometric("Rate about x (right), in rate_unit: cam2_from_cam1 over the exposure time.")
    wy: float | None = geometric("Rate about y (down). A gyroscope shows the negative.")
    wz: float | None = geometric("Rate about z (forwards). All three signs are open unless time_known.")
    sigma_wx: float | None = geometric("Standard deviation of wx.")
    sigma_wy: float | None = geometric("Standard deviation of wy.")
    sigma_wz: float | None = geometric("Standard deviation of wz.")
    backward: dict[str, Any] | None = geometric(
        """Geometry of the other order in time, with --readout: F, H, E, cam2_from_cam1, pose_covariance,
        config, parallax; null if no such geometry fits the rows."""
    )

    exposure_s: float | None = explained("Exposure time in seconds, from --exposure or EXIF.")
    readout_s: float | None = explained("Readout time in seconds; geometry is that of a global shutter.")
    time_known: bool = explained("Whether neighbours decided which end of the exposure came first.", False)
    time_confidence: float = explained("How sure that decision is, 0 to 1.", 0.0)
    mask: dict[str, Any] | None = explained(
        """Motion mask of segment: reason (what motion was measured against), shares (of the pixels that are
        static, moving, unobservable), regions (moving parts: area_px, box (x, y, width, height), centroid,
        probability)."""
    )
    beta: float | None = explained("Value of the option --beta.")
    max_error_px: float | None = explained("Value of the option --max-error.")
    seed: int | None = explained("Value of the option --seed.")
    threshold: float | None = explained("Value of the option --threshold of segment; null without a mask.")
    version: str = explained("Version of blur2view.", "")
    model_ids: list[str] | None = explained("Names of the weights of the networks that were used.")
    input_sha256: str = explained("SHA-256 of the file; over 4 GiB that of its size, start and end.", "")
    options_sha256: str = explained("SHA-256 of all else that the result depends on, for --resume.", "")
    files_sha256: str = explained("SHA-256 of the files that were written with this document.", "")

    @property
    def verdict(self) -> str:
        """What the photograph shows, in one sentence, which is also printed."""
        return verdict(self)

    @property
    def smear_percent(self) -> float | None:
        """Length of the smears in per cent of the width of the picture."""
        return None if self.smear_px is None or not self.width else 100 * self.smear_px / self.width

    @property
    def blur_px(self) -> float | None:
        """Width of all blur as the length of a smear in pixels; triage ranks photographs by it."""
        if self.smear_px is None:
            return None
        return math.hypot(self.smear_px, ALONG_SMEAR * (self.defocus_px or 0.0))

    @property
    def model(self) -> str:
        """Likeliest model: no motion, rotation, plane or parallax; empty if no models were compared."""
        return str(self.models[0]["model"]) if self.models else ""

    @property
    def model_probability(self) -> float | None:
        """Probability of the likeliest model, with a global or a rolling shutter."""
        return self.probability(self.model)

    @property
    def parallax_probability(self) -> float | None:
        """Probability that the smears show different depths; null if no models were compared."""
        return self.probability(MotionModel.PARALLAX)

    @property
    def rotation_probability(self) -> float | None:
        """Probability that the camera only turned."""
        return self.probability(MotionModel.ROTATION)

    @property
    def plane_probability(self) -> float | None:
        """Probability that the whole scene lies in one plane."""
        return self.probability(MotionModel.PLANE)

    @property
    def rotation_deg(self) -> float | None:
        """Angle of the rotation during the exposure in degrees."""
        if self.wx is None or self.wy is None or self.wz is None:
            return None
        return math.degrees(math.hypot(self.wx, self.wy, self.wz) * (self.exposure_s or 1.0))

    @property
    def rate_unit(self) -> str:
        """Unit of wx, wy and wz: rad/s, or rad if the exposure time is unknown; empty without a pose."""
        unit = "rad/s" if self.exposure_s else "rad"
        return "" if self.wx is None else unit

    def probability(self, model: str) -> float | None:
        """Return the probability of a model: 0 if it was not compared, None if no models were."""
        if not self.models:
            return None
        return sum((float(row["probability"]) for row in self.models if row["model"] == model), 0.0)

    def moved(self) -> bool:
        """Return whether the camera moved, so that a geometry was looked for."""
        return self.blur in CAMERA_KINDS

    def has_geometry(self) -> bool:
        """Return whether F or H explains the smears, so that the views of the exposure are of use."""
        return self.F is not None or self.H is not None

    @classmethod
    def from_estimate(cls, estimate: Recorded, *, name: str, **stated: Any) -> Record:
        """Return the record of an estimate with other, ``stated`` fields, as ``estimate.record`` does."""
        return estimate.record(name=name, **stated)

    def with_use(self, *limits_px: float) -> Self:
        """Return the record with the use of the photograph, given limits of a sharp one (`decide_use`)."""
        return replace(self, use=decide_use(self, *limits_px))

    def without_geometry(self) -> Self:
        """Return the record without geometry, as triage reads too few smears for it."""
        empty: dict[str, Any] = {
            entry.name: entry.default for entry in fields(self) if entry.metadata["geometry"]
        }
        return replace(self, **empty)

    def to_dict(self) -> dict[str, Any]:
        """Return every field and property as JSON's types; of a photograph that failed, name and error."""
        if self.error:
            return {"name": self.name, "error": self.error}
        return {key: getattr(self, key) for key, _, _ in entries()}

    def to_json(self) -> str:
        """Return the record as JSON text; ValueError for NaN and infinity, errors of the program."""
        return json.dumps(self.to_dict(), indent=2, allow_nan=False)

    @classmethod
    def from_json(cls, text: str | bytes) -> Self:
        """Return the record of JSON text by `to_json`; properties are computed anew.

        ValueError if the text holds no record.
        """
        try:
            document = json.loads(text)
        except (ValueError, RecursionError):
            document = None
        if not isinstance(document, dict) or not isinstance(document.get("name"), str):
            raise ValueError("is not a JSON document of a photograph")
        stored_fields = [entry for entry in fields(cls) if entry.name in document]
        for entry in stored_fields:
            kinds = [TYPES[kind.partition("[")[0]] for kind in str(entry.type).split(" | ")]
            if not isinstance(document[entry.name], tuple(kinds)):
                raise ValueError(f"{entry.name} is not a value of {entry.type}")
        return cls(**{entry.name: document[entry.name] for entry in stored_fields})


def plain(value: Any) -> Any:
    """Return a value in JSON's types: arrays and tuples as lists, names of an enumeration as strings."""
    if isinstance(value, dict):
        return {key: plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    if isinstance(value, StrEnum):
        return value.value
    return value.tolist() if hasattr(value, "tolist") else value  # of NumPy


def entries() -> Iterator[tuple[str, str, str]]:
    """Yield name, type and explanation of every field and property, in the order of JSON."""
    for entry in fields(Record):
        yield entry.name, str(entry.type), entry.metadata["help"]
    for name, value in vars(Record).items():
        if isinstance(value, property):
            kind = value.fget.__annotations__.get("return", "float | None")
            yield name, kind, " ".join((value.__doc__ or "").split())


def explanations(*, flat: bool = False) -> dict[str, str]:
    """Return the explanations of the keys of JSON or, if ``flat``, of the columns of a table, in order."""
    texts = {name: text for name, kind, text in entries() if not flat or kind.split()[0] in FLAT}
    return {name: texts[name] for name in dict.fromkeys([*LOOK, *texts])} if flat else texts


def table_text(rows: Iterable[Record], columns: Iterable[str] | None = None) -> bytes:
    """Return the records' flat part, or some columns of it, as CSV (RFC 4180, but lines end in LF).

    A header comes first. Bytes of names that are not UTF-8 stay as they are.
    """
    columns = list(explanations(flat=True) if columns is None else columns)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    for record in rows:
        filled = FAILED if record.error else columns
        writer.writerow(
            [_cell(column, getattr(record, column)) if column in filled else "" for column in columns]
        )
    return text.getvalue().encode("utf-8", "surrogateescape")


def _cell(column: str, value: object) -> object:
    """Return a value for a table; a text that a spreadsheet would compute begins with ./ instead."""
    if isinstance(value, str) and value.startswith(FORMULA):
        return f"./{value}"
    if not isinstance(value, float):
        return value
    return round(value, 6) if column == "timestamp_s" else f"{value:.6g}"  # times are of years
