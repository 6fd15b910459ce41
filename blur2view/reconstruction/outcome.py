"""What became of the frames of a video, by name, and how its report shows them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from blur2view.reconstruction.frames import Frame
from blur2view.results.blur_timeline import Seen


@dataclass(frozen=True, kw_only=True)
class Reconstruction:
    """A scene that was made, by names of frames in order."""

    folder: Path
    looked_at: tuple[str, ...]  # frames of the video
    chosen: tuple[str, ...]  # that are sharpest
    mapped: tuple[str, ...]  # that COLMAP got
    registered: tuple[str, ...]  # by COLMAP
    recovered: tuple[str, ...]  # by their blur
    refused: Mapping[str, str]  # the reason
    other_models: tuple[int, ...]  # frames in each further model of COLMAP that the largest one lacks
    moving: tuple[str, ...] | None  # in which anything moves by itself; None if no masks were asked for
    smear_px: Mapping[str, float | None]  # of frames that were delivered; None where it is unknown

    def smears_px(self, names: Sequence[str]) -> list[float] | None:
        """Return the smears of those frames that have one, pixels; None if any frame was not delivered."""
        if not self.smear_px.keys() >= set(names):
            return None
        return [smear for name in names if (smear := self.smear_px[name])]


def shown_frames(
    frames: Sequence[Frame],
    kinds: Mapping[str, str],
    result: Reconstruction,
    turned: Mapping[str, tuple[float, float]],
) -> list[Seen]:
    """Return what the report shows of each frame."""
    fates = dict.fromkeys(result.registered, "registered") | dict.fromkeys(result.recovered, "recovered")
    fates |= dict.fromkeys(result.refused, "refused")
    best = set(result.chosen)
    return [
        Seen(
            name=frame.name,
            number=frame.number,
            kind=kinds.get(frame.name, ""),
            smear_px=result.smear_px.get(frame.name),
            chosen=frame.name in best,
            fate=fates.get(frame.name, "left out"),
            reason=result.refused.get(frame.name, ""),
            turned=turned.get(frame.name),
        )
        for frame in frames
    ]
