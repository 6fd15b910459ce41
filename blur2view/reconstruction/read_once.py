"""Smears of a scene's frames, read once: what blurs a frame, its pose and its mask all need them."""

import hashlib
import json
from collections.abc import Sequence
from contextlib import suppress
from functools import cached_property
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from blur2view.arrays import AnyArray
from blur2view.files import open_regular
from blur2view.images.image import read_picture
from blur2view.networks.model_file import Execution
from blur2view.networks.smear_network import Detail, SmearNetwork, SmearReader
from blur2view.output import add_checked_line, checked_line, checked_lines, write_file
from blur2view.pipeline import estimate
from blur2view.reconstruction.scene import Step
from blur2view.smears.blur import BlurKind
from blur2view.smears.grid import DAMAGE, SmearGrid

LOOK_PX, LOOK_QUANTILE = 12.0, 0.9  # of smears: up to it a look serves for poses, this share of its cells


class KeptSmears:
    """A `SmearReader` that keeps what it has read in a folder, by the photograph's pixels and the detail.

    A process that gets it opens the network with one thread, and only if it must read.
    """

    def __init__(self, network: SmearReader, folder: Path) -> None:
        self.model_id, self.execution, self.folder = network.model_id, network.execution, folder
        self._given: SmearReader | Path = network

    def __getstate__(self) -> dict[str, Any]:
        given = self._given.path if isinstance(self._given, SmearNetwork) else self._given
        return {
            "model_id": self.model_id,
            "execution": Execution(threads=1, providers=self.execution.providers),
            "folder": self.folder,
            "_given": given,
        }

    @cached_property
    def _network(self) -> SmearReader:
        if not isinstance(self._given, Path):
            return self._given
        return SmearNetwork(self._given, threads=1, providers=self.execution.providers)

    def predict(self, image: AnyArray, *, detail: Detail = Detail.GEOMETRY) -> SmearGrid:
        """Return the smears of a photograph, as the network does."""
        pixels = repr((image.shape, image.dtype.str)).encode() + np.ascontiguousarray(image).tobytes()
        kept = self.folder / f"{hashlib.sha256(pixels).hexdigest()}_{Detail(detail).value}.npz"
        if kept.is_file():
            with suppress(*DAMAGE):  # then it is read again
                return _read(kept)
        grid = self._network.predict(image, detail=detail)
        write_file(kept, _content(grid))
        return grid


class AllWindows:
    """A `SmearReader` for masks: it reads all windows, also where a look is asked for."""

    def __init__(self, kept: SmearReader) -> None:
        self.model_id, self.execution, self._kept = kept.model_id, kept.execution, kept

    def predict(self, image: AnyArray, *, detail: Detail = Detail.GEOMETRY) -> SmearGrid:
        """Return the smears of a photograph in ``Detail.GEOMETRY``."""
        return self._kept.predict(image, detail=Detail.GEOMETRY)


class LooksAtShort:
    """A `SmearReader` for poses: of frames with short smears it has a look, a third of the work.

    Of the recovered frames of RedKitchen's three blurs and of two rendered videos those with smears of up to
    12 px, and neighbours, changed by -1 to +1 % in rotation and by 0 % in position.
    """

    def __init__(self, kept: SmearReader) -> None:
        self.model_id, self.execution, self._kept = kept.model_id, kept.execution, kept

    def predict(self, image: AnyArray, *, detail: Detail = Detail.GEOMETRY) -> SmearGrid:
        """Return the smears of a photograph, as the network does in that detail or in a look."""
        look = self._kept.predict(image, detail=Detail.RANKING)
        short = np.quantile(look.smears().length_px, LOOK_QUANTILE) <= LOOK_PX
        return look if short else self._kept.predict(image, detail=detail)


def blur_of_frames(
    images: Path, names: Sequence[str], notes: Path, network: SmearReader, step: Step
) -> dict[str, tuple[str, float | None]]:
    """Return what blurred each frame, and the length of its smear; ``notes`` keep what is done."""
    lines = checked_lines(notes)
    found: dict[str, tuple[str, float | None]] = {
        name: (kind, smear) for name, kind, smear in map(json.loads, lines)
    }
    write_file(notes, "".join(map(checked_line, lines)).encode())
    with step("reading blur") as show:
        for done, name in enumerate(names):
            show(done, len(names))
            if name in found:
                continue
            picture = read_picture(images / name, as_stored=True)
            seen = estimate(picture.pixels, network=network, detail=Detail.RANKING, geometry=False)
            blur = seen.blur
            other_px = None if blur.kind is BlurKind.CANNOT_TELL else 0.0
            smear_px = blur.smear_px if blur.kind.of_camera else other_px
            found[name] = str(blur.kind), None if smear_px is None else float(smear_px)
            add_checked_line(notes, json.dumps([name, *found[name]]))
    return found


def _content(grid: SmearGrid) -> bytes:
    """Return a grid as NPZ, in full precision."""
    arrays = {name: getattr(grid, name) for name in ("cells", "blur", "shares")}
    place = np.array([grid.stride, *grid.shape, grid.window_px or 0])
    file = BytesIO()
    np.savez(file, place=place, **{name: array for name, array in arrays.items() if array is not None})
    return file.getvalue()


def _read(path: Path) -> SmearGrid:
    """Return the grid of a file; errors of `DAMAGE` if it is not whole."""
    with open_regular(path) as file, np.load(file, allow_pickle=False) as arrays:
        stride, height, width, window_px = map(int, arrays["place"])
        return SmearGrid(
            cells=arrays["cells"],
            blur=arrays.get("blur"),
            shares=arrays.get("shares"),
            stride=stride,
            shape=(height, width),
            window_px=window_px or None,
        )
