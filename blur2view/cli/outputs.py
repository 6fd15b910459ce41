"""Files that the commands write beside each other: arrays, overlays, masks and documents."""

import io
from dataclasses import dataclass
from operator import methodcaller
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from blur2view.documents.estimate import EstimateDocument
from blur2view.documents.masks import MaskDocument
from blur2view.output_files import SIGNED_BY, Write
from blur2view.pipeline import FileEstimate
from blur2view.segmentation.formats import GREY, MaskFormat
from blur2view.segmentation.mask import MotionMask
from blur2view.smears.stored import StoredSmears
from blur2view.visualization.mask_overlay import draw_motion
from blur2view.visualization.overlay import draw_overlay

# The overlay is for looking at: fast deflate (3 of 9) is a third of the time of the best.
_PNG_EFFORT = 3


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


def result_contents(
    files: OutputFiles, document: EstimateDocument, one: FileEstimate, *, full_field: bool = False
) -> dict[Path, Write]:
    """Return what is written for a photograph: the arrays, the overlay and the document.

    Parameters
    ----------
    files : OutputFiles
        Where.
    document : EstimateDocument
        Of the photograph.
    one : FileEstimate
        The photograph and its estimate.
    full_field : bool
        Whether the smears of all pixels are written, which take much, instead of the network's grid.
    """
    geometry, matches, field = one.estimate.geometry, one.estimate.matches, one.estimate.field
    picture = draw_overlay(one.image, field, matches, geometry)
    encoded = png(Image.fromarray(picture))
    stored = StoredSmears(
        smears=field if full_field or one.estimate.grid is None else one.estimate.grid,
        ends=matches.ends,
        match_sigma_px=matches.weighed_across().sigma_px,
        inlier_mask=geometry.inlier_mask,
        swapped=geometry.swapped,
    )
    return {
        files.arrays: lambda file: np.savez(file, **stored.arrays()),  # type: ignore[arg-type]
        files.picture: methodcaller("write", encoded),
        files.document: methodcaller("write", (document.to_json() + "\n").encode()),
    }


@dataclass(frozen=True, kw_only=True)
class MaskFiles:
    """The four files of one photograph's mask, and the one for another program.

    Parameters
    ----------
    folder : Path
        Where they lie.
    stem : str
        The photograph's name without its suffix.
    exported : Path or None
        The mask as another program reads it.
    """

    folder: Path
    stem: str
    exported: Path | None = None

    @property
    def mask(self) -> Path:
        """``<stem>.mask.png``: 8-bit grey, 0 static, 255 moving, 128 unobservable."""
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
        """All, in the order of writing: the document last, so that it marks completeness."""
        first = () if self.exported is None else (self.exported,)
        return *first, self.mask, self.probability, self.picture, self.document


@dataclass(frozen=True, kw_only=True)
class MaskExport:
    """For which program masks are written, and whether it leaves out what is unobservable."""

    program: MaskFormat
    ignore_unobservable: bool


def mask_contents(
    files: MaskFiles,
    document: MaskDocument,
    image: NDArray[np.float32],
    mask: MotionMask,
    export: MaskExport | None = None,
) -> dict[Path, Write]:
    """Return what is written for a photograph: masks, probabilities, overlay and document."""
    levels = np.round(255 * mask.probability).astype(np.uint8)
    encoded = {
        files.mask: png(Image.fromarray(GREY[mask.labels])),
        files.probability: png(Image.fromarray(levels)),
        files.picture: png(Image.fromarray(draw_motion(image, mask))),
        files.document: (document.to_json() + "\n").encode(),
    }
    if files.exported is not None and export is not None:
        ignored = export.ignore_unobservable
        picture = export.program.picture(mask.labels, ignore_unobservable=ignored)
        encoded[files.exported] = png(Image.fromarray(picture))
    return {path: methodcaller("write", encoded[path]) for path in files.paths}


def png(picture: Image.Image) -> bytes:
    """Return a picture as a PNG that says who wrote it, which `output_files.is_ours` looks for."""
    text, stream = PngInfo(), io.BytesIO()
    text.add_text("Software", SIGNED_BY)
    picture.save(stream, "PNG", compress_level=_PNG_EFFORT, pnginfo=text)
    return stream.getvalue()
