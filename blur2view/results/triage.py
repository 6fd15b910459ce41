"""Which photographs are sharp: the command ``triage`` as a function."""

import os
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

from blur2view.errors import ImageError
from blur2view.images.image import read_picture
from blur2view.images.inputs import Inputs, Source, list_photographs
from blur2view.images.times import timestamp_of
from blur2view.images.video import EndOfVideo, frame_time
from blur2view.networks.smear_network import Detail, SmearNetwork, SmearReader
from blur2view.pipeline import estimate
from blur2view.records.record import Record
from blur2view.records.verdict import MAX_DEFOCUS_PX, MAX_SMEAR_PX

PathLike = str | os.PathLike[str]


def triage(
    paths: PathLike | Iterable[PathLike],
    *,
    max_smear_px: float = MAX_SMEAR_PX,
    max_defocus_px: float = MAX_DEFOCUS_PX,
    network: SmearReader | None = None,
) -> Iterator[Record]:
    """Return an iterator over what blurs photographs, and by how much.

    Parameters
    ----------
    paths : path or iterable of path
        Photographs; folders, of which all photographs are taken, or else all videos; videos, of which all
        frames are; ``@LIST``, a file that names one such path on each line.
    max_smear_px, max_defocus_px : float, optional
        Longest smear of a sharp photograph, and largest radius out of focus, pixels.
    network : SmearReader, optional
        Reads smears; by default a new `SmearNetwork`.

    Returns
    -------
    iterator of Record
        One of each photograph, in order, without geometry. Its ``use`` is "sharp", "blurred", "out of focus"
        or "unclear"; ``smear_px`` and ``defocus_px`` say how much, ``verdict`` in a sentence. Of a photograph
        that cannot be read ``error`` says why, and all else is empty.

    Raises
    ------
    ImageError
        If a list cannot be read, or names nothing.

    Examples
    --------
    >>> import blur2view
    >>> for record in blur2view.triage("models/sample.jpg"):
    ...     print(record.name, record.use)
    sample.jpg blurred
    """
    words = [paths] if isinstance(paths, str | os.PathLike) else paths
    inputs = list_photographs([os.fspath(word) for word in words])
    look = partial(_look, network or SmearNetwork(), max_smear_px, max_defocus_px)
    return _records(look, inputs)


def _records(look: Callable[[str, Source], Record], inputs: Inputs) -> Iterator[Record]:
    """Yield records; a video that is cut off fails once, and frames that were never recorded have none."""
    cut = set[Path]()
    for name, source in zip(inputs.names(), inputs.sources, strict=True):
        try:
            yield look(name, source)
        except EndOfVideo as end:
            if not end.whole and source.path not in cut:
                cut.add(source.path)
                yield Record(name=name, error=str(end))


def _look(
    network: SmearReader, max_smear_px: float, max_defocus_px: float, name: str, source: Source
) -> Record:
    """Return the record of one photograph; EndOfVideo if its video ends before."""
    try:
        if source.refusal:
            raise ImageError(source.refusal)
        picture = read_picture(source.path, content=None if source.frame is None else source.read())
        time_s = timestamp_of(source.name) if source.frame is None else frame_time(source.path, source.frame)

        def read(**asked: Any) -> Record:
            seen = estimate(picture.pixels, network=network, **asked)
            return seen.record(name=name, frame=source.frame, timestamp_s=time_s)

        return record_of_look(read, lambda record: (max_smear_px, max_defocus_px))
    except EndOfVideo:
        raise
    except (ImageError, ValueError) as error:
        return Record(name=name, error=str(error))


def record_of_look(
    read: Callable[..., Record],
    limits_px: Callable[[Record], tuple[float, float]],
    *,
    blurred: bool = False,
    closer: bool = True,
) -> Record:
    """Return what triage says of a photograph: its blur and its use, without a geometry.

    ``read`` returns the record of an `estimate` with the arguments that it is given, ``limits_px`` the
    longest smear and the largest radius of a sharp photograph. With ``blurred`` a geometry is looked for and
    decides on the use; ``closer`` is that of `estimate`.
    """
    record = read(detail=Detail.RANKING, geometry=blurred, closer=closer)
    record = record if blurred else record.without_geometry()
    return record.with_use(*limits_px(record)).without_geometry()
