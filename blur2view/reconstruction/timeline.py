"""The report of a scene: one HTML page with the video's blur over time, the camera's path, the frames.

It loads nothing but the frames that its thumbnails link to, and runs nothing.
"""

from collections import Counter
from collections.abc import Sequence
from html import escape
from pathlib import Path
from urllib.parse import quote

import cv2
import numpy as np

from blur2view.arrays import Array
from blur2view.colmap.models import read_model
from blur2view.exposure.views import CLOSE, OPEN
from blur2view.files import read_regular
from blur2view.results.blur_timeline import FATES, Seen, mark, smears_over_time, turning_over_time
from blur2view.results.blur_timeline import STYLE as SVG_STYLE
from blur2view.results.page import page
from blur2view.results.report import data_uri

THUMBNAIL_PX, THUMBNAILS = 160, 120  # longer side; at most so many, evenly
STYLE = """
:root { color-scheme: light; font: 15px/1.45 system-ui, sans-serif; }
body { max-width: 1140px; margin: auto; padding: 12px 20px; background: white; color: black; }
h2 { font-size: 18px; font-weight: normal; margin: 28px 0 4px; }
td, th { padding: 1px 16px 1px 0; text-align: left; font-weight: normal; }
.thumbs { display: grid; grid-template-columns: repeat(auto-fill, minmax(150px, 1fr)); gap: 8px; }
.thumbs a { font-size: 11px; color: inherit; text-decoration: none; overflow-wrap: anywhere; }
.thumbs img { width: 100%; display: block; border: 2px solid #2a6f97; box-sizing: border-box; }
.thumbs .recovered img { border: 4px double black; } .thumbs .refused img { border: 3px dotted #c9563c; }
.views { display: grid; grid-template-columns: 1fr 1fr; gap: 16px; }
@media print { .thumbs a { break-inside: avoid; } }
"""


def timeline(
    frames: Sequence[Seen], model: Path, images: Path, title: str, version: str, *, moving: int | None = None
) -> bytes:
    """Return the page, UTF-8; ``model`` is the folder of the one with views, ``images`` that of frames.

    In ``moving`` of the frames something moves by itself, if anybody has looked.
    """
    fates = Counter(frame.fate for frame in frames)
    rows = f"<tr><td>frames of the video</td><td>{len(frames)}</td></tr>"
    rows += f"<tr><td>chosen, the sharpest</td><td>{sum(frame.chosen for frame in frames)}</td></tr>"
    rows += "".join(f"<tr><td>{fate}, {FATES[fate]}</td><td>{fates[fate]}</td></tr>" for fate in FATES)
    if moving is not None:
        rows += f"<tr><td>in which something moves by itself</td><td>{moving}</td></tr>"
    reasons = Counter(frame.reason for frame in frames if frame.reason)
    rows += "".join(f"<tr><td>refused: {escape(why)}</td><td>{n}</td></tr>" for why, n in reasons.items())
    body = f"""<p><b>blur2view</b> scene of {escape(title)}</p>
<table>{rows}</table>
<h2>Blur over time</h2>
{smears_over_time(frames)}
{_turning(frames)}<h2>The camera's path</h2>
{_paths(frames, model)}
<h2>Frames</h2>
<div class="thumbs">{"".join(_thumbnails(frames, images))}</div>"""
    return page(title, body, style=SVG_STYLE + STYLE, version=version)


def _turning(frames: Sequence[Seen]) -> str:
    """Return the picture of how the camera turned, with its heading; nothing if no frame says so."""
    picture = turning_over_time(frames, "degrees")
    return (
        f"<h2>How the camera turned during each exposure, with its standard deviation</h2>\n{picture}\n"
        if picture
        else ""
    )


def _paths(frames: Sequence[Seen], folder: Path) -> str:
    """Return the camera's path from above and from the side, with both ends of exposures as lines."""
    model = read_model(folder)
    centres = {image.name: image.projection_center() for image in model.images.values() if image.has_pose}
    posed = [frame for frame in frames if frame.name in centres]
    cameras = [model.find_image_with_name(frame.name).cam_from_world().rotation.matrix() for frame in posed]
    places = np.array([centres[frame.name] for frame in posed])
    down = np.mean([R[1] for R in cameras], axis=0)
    down /= np.linalg.norm(down)
    level = places - places.mean(axis=0)
    level -= np.outer(level @ down, down)
    across = np.linalg.svd(level, full_matrices=False)[2][0]
    axes = np.stack([across, np.cross(down, across), down])
    pictures = [
        _path(posed, centres, axes[[0, 1]], "from above"),
        _path(posed, centres, axes[[0, 2]], "from the side"),
    ]
    return f'<div class="views">{"".join(pictures)}</div>'


def _path(frames: Sequence[Seen], centres: dict[str, Array], axes: Array, label: str) -> str:
    """Return one picture of the path, by the axes (2, 3) to the right and downwards."""
    points = np.array([axes @ centre for centre in centres.values()])
    low, extent = points.min(axis=0), max(float(np.ptp(points, axis=0).max()), 1e-9)
    side, edge = 520, 24

    def place(name: str) -> Array:
        return np.asarray(edge + (side - 2 * edge) * (axes @ centres[name] - low) / extent)

    height = 2 * edge + (side - 2 * edge) * float(np.ptp(points[:, 1])) / extent + 20
    line = "L".join("{:.1f} {:.1f}".format(*place(frame.name)) for frame in frames)
    parts = [f'<path d="M{line}" fill="none" stroke="#bbb" stroke-width="1.5"/>']
    for frame in frames:
        ends = [frame.name + OPEN, frame.name + CLOSE]
        if all(end in centres for end in ends):
            both = "L".join("{:.1f} {:.1f}".format(*place(end)) for end in ends)
            parts.append(f'<path d="M{both}" stroke="black" stroke-width="2.5"/>')
        x, y = place(frame.name).tolist()
        parts.append(mark(x, y, frame.fate, "#2a6f97", f"{frame.name}, {frame.fate}"))
    text = f'<text x="{edge}" y="{height - 6:.0f}">{label}; lines: both ends of an exposure</text>'
    view = f'viewBox="0 0 {side} {height:.0f}" role="img" aria-label="path {label}"'
    return f"<svg {view}>{''.join(parts)}{text}</svg>"


def _thumbnails(frames: Sequence[Seen], images: Path) -> list[str]:
    """Return small pictures that link to the frames."""
    there = [frame for frame in frames if frame.fate != "left out"]
    some = there[:: max(1, -(-len(there) // THUMBNAILS))]
    found = []
    for frame in some:
        encoded = np.frombuffer(read_regular(images / frame.name), np.uint8)
        picture = cv2.imdecode(encoded, cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
        if picture is None:
            continue
        scale = THUMBNAIL_PX / max(picture.shape)
        small = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        source = data_uri(
            "image/jpeg", cv2.imencode(".jpg", small, (cv2.IMWRITE_JPEG_QUALITY, 80))[1].tobytes()
        )
        link, name = quote(f"{images.name}/{frame.name}"), escape(frame.name)
        found.append(
            f'<a class="{frame.fate}" href="{link}"><img src="{source}" alt="{name}">{name}, {frame.fate}</a>'
        )
    return found
