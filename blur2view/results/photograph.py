"""The record of a photograph: everything that blur2view says of it, in one object of JSON's types.

JSON is the record itself, a row of CSV its flat part, ``--help-all`` the explanations of its fields. What
follows from other fields is computed when it is asked for (`derived`), and never read back.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any, Self

from blur2view.results.record import Record, derived
from blur2view.results.verdict import use_of, verdict

if TYPE_CHECKING:
    from blur2view.geometry.two_view_geometry import TwoViewGeometry
    from blur2view.movers.mask import MotionMask
    from blur2view.pipeline import Estimate

FIRST = "name", "error", "use", "verdict", "blur"
"""Columns of a table that come first."""
FORMULA = "=", "+", "-", "@", "\t", "\r"  # how names begin that a spreadsheet takes for formulas


class Photograph(Record):
    """The record of one photograph, with its verdict, as JSON and as a row of a table."""

    @classmethod
    def of(cls, estimate: Estimate, *, name: str, mask: MotionMask | None = None, **stated: Any) -> Self:
        """Return the record of an estimate and what moves, if that was asked.

        ``stated`` are fields that they do not know, or other values.
        """
        blur, geometry, camera = estimate.blur, estimate.geometry, estimate.camera
        height, width = estimate.grid.shape
        known = {
            "width": width,
            "height": height,
            "blur": blur.kind,
            **{key: getattr(blur, key) for key in _BLUR},
            "moving_share": None if estimate.moving is None else blur.moving_share,
            "timestamp_s": estimate.timestamp_s,
            "model_ids": [estimate.model_id],
            "K": None if camera is None else camera.K,
            "camera": _part(camera, "model", "params", "source", "known"),
            **_geometry(geometry),
            "reason": geometry.reason,
            "models": [_part(row, *_MODEL) for row in geometry.models],
            "independent_smears": geometry.independent_smears,
            "num_matches": len(estimate.matches),
            "num_inliers": int(geometry.inlier_mask.sum()),
            "support_by_chance": geometry.support_by_chance,
            "backward": None if geometry.backward is None else _geometry(geometry.backward),
            "readout_s": None if estimate.shutter is None else estimate.shutter.readout_s,
            "time_known": estimate.time.known,
            "time_confidence": estimate.time.confidence,
            **({} if mask is None else _mask(mask)),
        }
        return cls(**{key: _plain(value) for key, value in {"name": name, **known, **stated}.items()})

    def of_use(self, *limits_px: float) -> Self:
        """Return the record with what the photograph is of use for, as of `verdict.use_of`."""
        return replace(self, use=use_of(self, *limits_px))

    def of_blur_alone(self) -> Self:
        """Return what the record says but for geometry, as of a photograph looked at less closely."""
        fresh, names = Photograph(name=self.name), [one.name for one in fields(self)]
        geometry = names[names.index("config") : names.index("backward") + 1]
        return replace(self, **{name: getattr(fresh, name) for name in geometry})

    @derived
    def verdict(self) -> str:
        """What the photograph shows, in words: the line that is printed."""
        return verdict(self)

    def plain(self) -> dict[str, Any]:
        """Return what JSON holds: every field and, where the photograph did not fail, what is derived."""
        if self.error:
            return {"name": self.name, "error": self.error}
        return {key: getattr(self, key) for key, _, _ in entries()}

    def to_json(self) -> str:
        """Return the record as JSON text; NaN and infinity are errors of the program."""
        return json.dumps(self.plain(), indent=2, allow_nan=False)

    @classmethod
    def from_json(cls, text: str | bytes) -> Self:
        """Return the record that JSON text of `to_json` holds; what is derived is computed anew.

        ValueError if it holds no record.
        """
        stored = json.loads(text)
        if not isinstance(stored, dict) or not isinstance(stored.get("name"), str):
            raise ValueError("is no JSON document of a photograph")
        return cls(**{one.name: stored[one.name] for one in fields(cls) if one.name in stored})


_BLUR = ("nothing_seen", "smear_px", "smear_sigma_px", "direction_deg", "defocus_px", "defocus_sigma_px")
_MODEL = ("model", "parameters", "log_likelihood", "probability")
_COVARIANCE = ("matrix", "tangents", "rotation_sigma_deg", "translation_sigma_deg")


def _geometry(geometry: TwoViewGeometry) -> dict[str, Any]:
    """Return the fields of a geometry that has a reverse in time."""
    pose = geometry.cam2_from_cam1
    values = {
        "F": geometry.F,
        "H": geometry.H,
        "E": None if pose is None else geometry.E,
        "cam2_from_cam1": _part(pose, "rotation", "translation"),
        "pose_covariance": _part(geometry.covariance, *_COVARIANCE),
        "config": geometry.config,
        "parallax": geometry.parallax,
    }
    return {name: _plain(value) for name, value in values.items()}


def _mask(mask: MotionMask) -> dict[str, Any]:
    """Return the fields of a motion mask."""
    regions = [_part(one, "area_px", "box", "centroid", "probability") for one in mask.regions]
    return {
        "moving_share": mask.shares["moving"],
        "mask": {"reason": mask.reason, "shares": mask.shares, "regions": regions},
    }


def _part(source: Any, *names: str) -> dict[str, Any] | None:
    """Return what a record holds of an object, its attributes of these names; None of None."""
    return None if source is None else {name: _plain(getattr(source, name)) for name in names}


def _plain(value: Any) -> Any:
    """Return an array or tuple as a list, an enum as its text."""
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, str):
        return str(value)
    return [_plain(one) for one in value] if isinstance(value, Sequence) else value


def entries() -> Iterator[tuple[str, str, str]]:
    """Yield name, type and explanation of everything that a record holds, in the order of JSON."""
    for one in fields(Photograph):
        yield one.name, str(one.type), one.metadata["help"]
    for name, value in (vars(Photograph) | vars(Record)).items():
        if isinstance(value, derived):
            yield name, value.kind, value.text


def explanations(*, flat: bool = False) -> dict[str, str]:
    """Return what explains the keys of JSON or, if ``flat``, the columns of a table."""
    plain = ("str", "int", "float", "bool")
    return {name: text for name, kind, text in entries() if not flat or kind.split()[0] in plain}


def table_text(rows: Iterable[Photograph]) -> bytes:
    """Return the records' flat part as CSV (RFC 4180, but for the ends of lines) with a header.

    Names may be no text.
    """
    columns = list(dict.fromkeys([*FIRST, *explanations(flat=True)]))
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    for one in rows:
        writer.writerow([_cell(column, getattr(one, column)) for column in columns])
    return text.getvalue().encode("utf-8", "surrogateescape")


def _cell(column: str, value: object) -> object:
    """Return a value as a table has it; what a spreadsheet would compute is a path from the folder."""
    if isinstance(value, str) and value.startswith(FORMULA):
        return f"./{value}"
    if not isinstance(value, float):
        return value
    return round(value, 6) if column == "timestamp_s" else f"{value:.6g}"  # times are of years
