"""Which frames are looked at closely where one of some neighbours is chosen, and what is kept of them.

Neighbours show the same things, so that gradients, which blur weakens, compare them well at a fraction of the
cost of the network: it reads those with the most gradient energy (`SHARE`). A video is decoded once,
forwards: the frames that are kept are encoded as they pass.
"""

import tempfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import inf
from pathlib import Path
from typing import Self

import cv2
import numpy as np

from blur2view.arrays import TINY, AnyArray, white_level
from blur2view.cli.batch.executors import Shared
from blur2view.cli.batch.job import Job, Outcome
from blur2view.errors import ImageError
from blur2view.images.image import Content, read_picture
from blur2view.images.inputs import Source, encode_png
from blur2view.images.pixels import brightness_gain, gradient_energy
from blur2view.images.video import EndOfVideo, frame_time
from blur2view.output import unwritable, writable_folder
from blur2view.records.record import Record
from blur2view.records.verdict import Use

NEIGHBOURS = 12  # bound: of so many at most gradients are compared, because they show the same things
SHARE, LEAST = 4, 2
"""Of so many neighbours the network reads one, but two at least. Of 3 to 15 neighbours in nine videos (page
chosen_frames.md of tools/results) the chosen frame was 1.039 times as blurred as the best one; with a third,
chosen by the sum of squared gradients and ranked by the network alone, 1.051
(``tools.evaluation.chosen_frames WORK --videos 8`` compares them)."""
MIN_WIDTH_PX = 1.0  # bound: shorter widths of blur differ by noise


class Candidates:
    """The jobs of each group that may be its sharpest, read, in order, with their energy as the plan.

    Jobs that cannot be read are always among them. Memory holds the contents of one in
    `SHARE` of `NEIGHBOURS` photographs. After all of them ``there`` is the number of photographs, without
    frames that a video announces and does not have.
    """

    def __init__(self, groups: Iterable[Sequence[Job]]) -> None:
        self._groups, self.there = groups, 0

    def __iter__(self) -> Iterator[Job]:
        """Yield the jobs, which are not held any longer."""
        for group in self._groups:
            runs = -(-len(group) // NEIGHBOURS)
            for part in np.array_split(np.arange(len(group)), runs):
                sharper = self._sharper([group[k] for k in part])
                while sharper:
                    yield sharper.pop(0)

    def _sharper(self, jobs: Sequence[Job]) -> list[Job]:
        """Return the neighbours with the most gradient energy, and those that have none."""
        wanted, kept = max(-(-len(jobs) // SHARE), LEAST), list[Job]()
        for job in jobs:
            kept.append(self._read(job))
            compared = [place for place, one in enumerate(kept) if one.plan is not None]
            if len(compared) > wanted:
                del kept[min(compared, key=lambda place: (kept[place].plan, -place))]
        return kept

    def _read(self, job: Job) -> Job:
        """Return a job with its content, a frame's time, and the gradient energy as its plan."""
        source = job.source
        self.there += 1
        try:
            if job.refusal is not None:
                return job
            content = source.read()
            if source.frame is not None:
                source = replace(source, time_s=frame_time(source.path, source.frame))
            energy = gradient_energy(_eight_bits(source, content))
            return replace(job, source=source, content=content, plan=energy)
        except EndOfVideo:
            self.there -= 1
        except (ImageError, cv2.error):  # which is said where it is read
            pass
        return job


def _eight_bits(source: Source, content: Content) -> AnyArray:
    """Return the pixels of a content, or its luma, uint8; ImageError if they cannot be read."""
    if not isinstance(content, bytes):
        return content
    decoded = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH)
    if decoded is None or decoded.dtype != np.uint8:  # as HEIC, or of 16 bits, whose values may have 8
        pixels = read_picture(source.path, content=content).pixels
        # files of 16 bits may use only 10 or 12 of these
        gain = 1.0 if pixels.dtype == np.uint8 else brightness_gain(pixels)
        return np.asarray(cv2.convertScaleAbs(pixels, alpha=255 * gain / white_level(pixels)))
    return np.asarray(decoded)


Rank = tuple[bool, float]
"""Less is sharper: whether it is not called sharp, and the width of all of its blur, over its gradient energy
where that is known."""


def sharpness_rank(record: Record, energy: float | None = None) -> Rank:
    """Return the place of a photograph among others; where nothing is seen it comes last.

    Of neighbours both measures err by as much, a quarter of the width, and by different things.
    """
    if record.blur_px is None:
        return True, inf
    width = record.blur_px if energy is None else max(record.blur_px, MIN_WIDTH_PX) / max(energy, TINY)
    return record.use != Use.SHARP, width


@dataclass(frozen=True, kw_only=True, eq=False)
class Candidate:
    """A photograph that may be kept, and of a frame the pixels, unless they are encoded."""

    job: Job
    rank: Rank
    content: Content | Shared | None = None


class Chosen:
    """What is kept of photographs that pass in order: the sharpest of each group, by which a job is in one.

    ``wanted`` are the uses that are kept, all if empty, ``most`` the number. The frames that are kept are put
    into ``pictures`` once their group has passed.
    """

    def __init__(
        self,
        jobs: Sequence[Job],
        groups: Sequence[Sequence[Job]],
        *,
        wanted: Sequence[Use] = (),
        most: int | None = None,
        pictures: "Pictures | None" = None,
    ) -> None:
        self._place = {job.source: place for place, job in enumerate(jobs)}
        self._group = {job.source: group for group, own in enumerate(groups) for job in own}
        self._last = [max(self._place[job.source] for job in own) for own in groups]
        self._wanted, self._most, self._pictures = wanted, most, pictures
        self._open, self._kept = dict[int, Candidate](), list[Candidate]()

    def add(self, job: Job, outcome: Outcome) -> None:
        """Take one that has been looked at, with its content."""
        record, group = outcome.record, self._group[job.source]
        if not record.error and (not self._wanted or record.use in self._wanted):
            content = None if job.source.frame is None or self._pictures is None else job.content
            new = Candidate(
                job=replace(job, content=None), rank=sharpness_rank(record, job.plan), content=content
            )
            if group not in self._open or new.rank < self._open[group].rank:
                self._open[group] = new
        self._close(self._place[job.source])

    def _close(self, place: int) -> None:
        """Keep the sharpest of the groups of which nothing comes behind a place."""
        for group in [group for group in self._open if self._last[group] <= place]:
            one = self._open.pop(group)
            self._kept.append(replace(one, content=None))
            if self._most is not None and len(self._kept) > self._most:
                self._kept.remove(max(self._kept, key=lambda one: (one.rank, self._place[one.job.source])))
            if one.content is not None and self._pictures is not None and self._kept[-1].job is one.job:
                self._pictures.add(one.job.source, one.content)

    def kept(self) -> list[Job]:
        """Return those that are kept, in order."""
        self._close(len(self._place))
        return sorted((one.job for one in self._kept), key=lambda job: self._place[job.source])


class Pictures:
    """PNG files of frames, in a file without a name below a folder, so that nothing is left if all ends."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._ranges = folder, dict[Source, tuple[int, int]]()
        self._file = tempfile.TemporaryFile(dir=writable_folder(folder))  # noqa: SIM115  closed by __exit__

    def add(self, source: Source, content: Content | Shared) -> None:
        """Encode the pixels of a frame; OutputError if the disk is full."""
        pixels = content.read() if isinstance(content, Shared) else content
        encoded = encode_png(np.asarray(pixels))
        try:
            start = self._file.seek(0, 2)
            self._file.write(encoded)
        except OSError as error:
            raise unwritable(self._folder, error) from error
        self._ranges[source] = start, len(encoded)

    def get(self, source: Source) -> bytes | None:
        """Return the file of a frame, None if it was not put here."""
        if source not in self._ranges:
            return None
        start, size = self._ranges[source]
        self._file.seek(start)
        return self._file.read(size)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()
