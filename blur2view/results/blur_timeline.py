"""Pictures (SVG) of what blurs the frames of a video over time, for pages that run nothing.

Marks differ in shape and fill, too, so that a page prints in grey.
"""

from collections.abc import Iterator, Sequence
from html import escape
from typing import NamedTuple

WIDTH, HEIGHT, MARGIN = 1100, 260, 44
KIND_COLOURS = ("#2a6f97", "#c9563c", "#8a8f3c", "#7b5ea7", "#a08060", "#999999")
FATES = {
    "registered": "by COLMAP",
    "recovered": "by its blur",
    "refused": "has no pose",
    "left out": "not used",
}
STYLE = """
svg { width: 100%; height: auto; display: block; margin: 8px 0; }
text { font: 12px system-ui, sans-serif; fill: currentColor; }"""


class Seen(NamedTuple):
    """A frame of the video, as a page shows it."""

    name: str
    number: int
    kind: str  # of blur, empty if it was not read
    smear_px: float | None
    chosen: bool = False
    fate: str = ""  # one of FATES, empty where there is no scene
    reason: str = ""  # why it is refused
    turned: tuple[float, float] | None = None  # by how much the camera turned, and its standard deviation
    link: str = ""  # to what the page says of it


def mark(x: float, y: float, fate: str, colour: str, title: str) -> str:
    """Return a mark: a ring if recovered, a cross if refused, smaller if left out, else a dot."""
    text = f"<title>{escape(title)}</title>"
    if fate == "recovered":
        ring = f'r="4.5" fill="white" stroke="{colour}" stroke-width="2.5"'
        return f'<circle cx="{x:.1f}" cy="{y:.1f}" {ring}>{text}</circle>'
    if fate in ("refused", "left out"):
        size = 5 if fate == "refused" else 2
        path = f"M{x - size:.1f} {y - size:.1f}l{2 * size} {2 * size}m0 {-2 * size}l{-2 * size} {2 * size}"
        return f'<path d="{path}" stroke="{colour}" stroke-width="2" fill="none">{text}</path>'
    return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" fill="{colour}">{text}</circle>'


def smears_over_time(frames: Sequence[Seen]) -> str:
    """Return the picture of smears over the frames' numbers, coloured by the kind of blur."""
    known = [frame for frame in frames if frame.smear_px is not None]
    plot = _Plot(frames, max([1.0, *(frame.smear_px or 0.0 for frame in known)]))
    kinds = list(dict.fromkeys(frame.kind for frame in known))
    colours = dict(zip(kinds, KIND_COLOURS * (1 + len(kinds) // len(KIND_COLOURS)), strict=False))
    parts = list(plot.axes("px"))
    for frame in frames:
        x = plot.x(frame)
        if frame.chosen:
            parts.append(f'<path d="M{x:.1f} {plot.bottom + 3}v7" stroke="currentColor" stroke-width="1.5"/>')
        if frame.smear_px is not None:
            y = plot.y(frame.smear_px)
            title = f"{frame.name}: {frame.kind} {frame.smear_px:.1f} px {frame.fate} {frame.reason}".strip()
            parts.append(f'<path d="M{x:.1f} {plot.bottom}V{y:.1f}" stroke="#ddd"/>')
            parts.append(_linked(frame, mark(x, y, frame.fate, colours[frame.kind], title)))
    notes = ["ticks: chosen"] * any(frame.chosen for frame in frames)
    notes += ["frames without a mark were not measured"] * (len(known) < len(frames))
    parts.append(f'<text x="{WIDTH / 2}" y="{HEIGHT - 12}" text-anchor="middle">{"; ".join(notes)}</text>')
    fates = [fate for fate in FATES if any(frame.fate == fate for frame in known)]
    legend = ""
    for place, fate in enumerate(fates):
        x = MARGIN + 16 + 120 * place
        legend += mark(x, 16, fate, "currentColor", fate) + f'<text x="{x + 10}" y="20">{fate}</text>'
    for place, kind in enumerate(kinds):
        x = MARGIN + 16 + 120 * (len(fates) + place)
        legend += f'<rect x="{x - 5}" y="10" width="11" height="11" fill="{colours[kind]}"/>'
        legend += f'<text x="{x + 10}" y="20">{escape(kind)}</text>'
    return _svg("Length of smears over frames", legend, *parts)


def turning_over_time(frames: Sequence[Seen], unit: str) -> str:
    """Return the picture of how much the camera turned, with a bar of two standard deviations; or nothing."""
    known = [frame for frame in frames if frame.turned is not None]
    if not known:
        return ""
    plot = _Plot(frames, max(angle + sigma for angle, sigma in filter(None, (one.turned for one in known))))
    parts = list(plot.axes(unit))
    for frame in known:
        angle, sigma = frame.turned or (0.0, 0.0)
        x, ends = plot.x(frame), (plot.y(max(angle - sigma, 0.0)), plot.y(angle + sigma))
        title = f"{frame.name}: {angle:.3g} +/- {sigma:.2g} {unit}"
        parts.append(f'<path d="M{x:.1f} {ends[0]:.1f}V{ends[1]:.1f}" stroke="#888" stroke-width="2"/>')
        parts.append(_linked(frame, mark(x, plot.y(angle), frame.fate, KIND_COLOURS[0], title)))
    return _svg(f"Turning of the camera over frames, {unit}", *parts)


class _Plot:
    """The places of frames and values up to ``top`` in a picture."""

    bottom = HEIGHT - MARGIN

    def __init__(self, frames: Sequence[Seen], top: float) -> None:
        numbers = [frame.number for frame in frames]  # in the order in which they were named
        self.first, self.last = min(numbers), max(*numbers, min(numbers) + 1)
        self.top = max(top, 1e-9)

    def x(self, frame: Seen) -> float:
        """Return where a frame is, from left to right."""
        return MARGIN + 10 + (WIDTH - MARGIN - 30) * (frame.number - self.first) / (self.last - self.first)

    def y(self, value: float) -> float:
        """Return where a value is, downwards."""
        return self.bottom - value / self.top * (self.bottom - MARGIN)

    def axes(self, unit: str) -> Iterator[str]:
        """Yield lines at no, half and the largest value, and the numbers of the first and the last frame."""
        for share in (0.0, 0.5, 1.0):
            y, value = self.y(share * self.top), share * self.top
            said = f"{value:.0f}" if self.top >= 10 else f"{value:.2g}"
            yield f'<path d="M{MARGIN} {y:.1f}H{WIDTH - 10}" stroke="#ccc"/>'
            yield f'<text x="{MARGIN - 6}" y="{y + 4:.1f}" text-anchor="end">{said}</text>'
        yield f'<text x="4" y="{MARGIN - 14}">{escape(unit)}</text>'
        yield f'<text x="{MARGIN + 10}" y="{HEIGHT - 12}">frame {self.first}</text>'
        yield f'<text x="{WIDTH - 12}" y="{HEIGHT - 12}" text-anchor="end">frame {self.last}</text>'


def _linked(frame: Seen, part: str) -> str:
    return f'<a href="{escape(frame.link)}">{part}</a>' if frame.link else part


def _svg(label: str, *parts: str) -> str:
    return f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{label}">{"".join(parts)}</svg>'
