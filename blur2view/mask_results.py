"""Motion masks on disk and on the terminal: an indexed mask, probabilities, an overlay, JSON."""

import io
import json
from dataclasses import dataclass
from operator import methodcaller
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from PIL import Image

from blur2view.estimate_file import FileEstimate
from blur2view.mask_overlay import PINK, draw_motion, headline
from blur2view.results import unwritable, write_atomically
from blur2view.segmentation import MotionLabel, MotionMask, MovingRegion

PALETTE = {MotionLabel.STATIC: (0, 0, 0), MotionLabel.MOVING: PINK, MotionLabel.UNOBSERVABLE: (110, 110, 110)}


@dataclass(frozen=True, kw_only=True)
class MaskFiles:
    """The four files of one photograph's mask.

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
    def mask(self) -> Path:
        """``<stem>.mask.png``: one byte per pixel, a `MotionLabel`, with a palette."""
        return self.folder / f"{self.stem}.mask.png"

    @property
    def probability(self) -> Path:
        """``<stem>.moving.png``: probability times 255."""
        return self.folder / f"{self.stem}.moving.png"

    @property
    def picture(self) -> Path:
        """``<stem>.motion.png``."""
        return self.folder / f"{self.stem}.motion.png"

    @property
    def document(self) -> Path:
        """``<stem>.motion.json``."""
        return self.folder / f"{self.stem}.motion.json"

    @property
    def paths(self) -> tuple[Path, ...]:
        """All four, in the order of writing: the document last, so that it marks completeness."""
        return self.mask, self.probability, self.picture, self.document


def mask_document(one: FileEstimate, mask: MotionMask, segment_s: float) -> dict[str, Any]:
    """Return the JSON document of one photograph's mask; the README lists its keys.

    Parameters
    ----------
    one : FileEstimate
    mask : MotionMask
        Of that photograph.
    segment_s : float
        Seconds that the mask took.
    """
    kept = ("image", "width", "height", "F", "H", "config")
    shares = {label.name.lower(): float((mask.labels == label).mean()) for label in MotionLabel}
    return {
        **{key: one.facts[key] for key in kept},
        "geometry_reason": one.facts["reason"],
        "reason": mask.reason,
        "labels": {label.name.lower(): int(label) for label in MotionLabel},
        "shares": shares,
        "regions": [region_facts(region) for region in mask.regions],
        "beta": one.facts["beta"],
        "max_error_px": one.facts["max_error_px"],
        "seed": one.facts["seed"],
        "model_id": one.facts["model_id"],
        "motion_model_id": mask.model_id or None,
        "timings_s": one.facts["timings_s"] | {"segment": segment_s},
    }


def region_facts(region: MovingRegion) -> dict[str, Any]:
    """Return a region in plain JSON types."""
    return {
        "area_px": region.area_px,
        "box": list(region.box),
        "centroid": list(region.centroid),
        "score": region.score,
        "F": None if region.F is None else region.F.tolist(),
        "H": None if region.H is None else region.H.tolist(),
        "reason": region.reason,
    }


def write_mask(files: MaskFiles, facts: dict[str, Any], one: FileEstimate, mask: MotionMask) -> None:
    """Write mask, probabilities, overlay and document, each whole or not at all.

    Raises
    ------
    OutputError
        If a file cannot be written.
    """
    levels = np.round(255 * mask.probability).astype(np.uint8)
    encoded = {
        files.mask: indexed_png(mask),
        files.probability: cv2.imencode(".png", levels)[1].tobytes(),
        files.picture: cv2.imencode(".png", draw_motion(one.image, mask)[..., ::-1])[1].tobytes(),
        files.document: (json.dumps(facts, indent=2, allow_nan=False) + "\n").encode(),
    }
    try:
        files.document.unlink(missing_ok=True)  # an older one must not vouch for a new mask if we are killed
        for path in files.paths:
            write_atomically(path, methodcaller("write", encoded[path]))
    except OSError as error:
        raise unwritable(files.folder, error) from None


def indexed_png(mask: MotionMask) -> bytes:
    """Encode the labels as a PNG whose pixels are `MotionLabel`, with a palette to look at."""
    picture = Image.fromarray(mask.labels)
    picture.putpalette([level for label in MotionLabel for level in PALETTE[label]])
    stream = io.BytesIO()
    picture.save(stream, "PNG")
    return stream.getvalue()


def mask_summary(facts: dict[str, Any], mask: MotionMask, files: MaskFiles | None) -> str:
    """Return a few readable lines about one photograph's mask."""
    lines = [f"{facts['image']}: {headline(mask)}", mask.reason]
    for region in mask.regions:
        x, y, width, height = region.box
        line = f"{region.area_px} px at ({x}, {y}), {width}x{height}, score {region.score:.1f}"
        lines.append(f"{line}; {region.reason}" if region.reason else line)
    lines.append(f"{sum(facts['timings_s'].values()):.2f} s")
    if files:
        lines[-1] += f"; wrote {', '.join(str(path) for path in reversed(files.paths))}"
    return "\n  ".join(lines)
