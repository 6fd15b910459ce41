"""The report: one HTML file that holds everything and loads nothing.

A photograph is a section of the page, `section`: its picture under layers of SVG in its own pixels, and what
its record says. Failed ones have a line of the index with their reason.
"""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Iterable, Sequence
from html import escape
from importlib.resources import files
from io import BytesIO
from string import Template

import cv2
import numpy as np
from PIL import Image

from blur2view.arrays import AnyArray
from blur2view.geometry.epipolar import serrmin
from blur2view.movers.mask import MotionLabel, MotionMask
from blur2view.pipeline import Estimate
from blur2view.results.overlay import (
    PINK,
    SQUARES,
    View,
    draw_smears,
    drawn_smears,
    epipolar_lines,
    epipoles_within,
    lines_of,
    orientation_colours,
    png,
    spread_subset,
)
from blur2view.results.photograph import Photograph, entries
from blur2view.results.verdict import rounded

PICTURE_SIDE_PX, THUMBNAIL_SIDE_PX, MASK_SIDE_PX = 2048, 160, 1024
PICTURE_QUALITY, THUMBNAIL_QUALITY = 90, 80  # of JPEG; a 1280x720 street has 160 kB at 90
MOVING_RGBA, UNSEEN_RGBA = (*PINK, 150), (0, 0, 0, 140)
ELSEWHERE = (
    "name",
    "width",
    "height",
    "verdict",
    "config",
    "models",
    "model_ids",
    "input_sha256",
    "options_sha256",
)


def section(one: Photograph, estimate: Estimate, image: AnyArray, mask: MotionMask | None = None) -> str:
    """Return the HTML of a photograph, with ``@NUMBER@`` where its number on the page belongs.

    ``image`` (H, W, 3) is the photograph as it was estimated, ``mask`` what moves in it, if that was asked.
    """
    side = min(PICTURE_SIDE_PX, max(image.shape[:2]))
    picture = View.of(image.shape, side).picture(image)
    layers = [_uncertainty(estimate), *([] if mask is None else _mask(mask))]
    return Template(_part("photograph.html")).substitute(
        number="@NUMBER@",
        name=escape(one.name),
        verdict=escape(one.verdict),
        config=escape(one.config),
        width=one.width,
        height=one.height,
        picture=_jpeg(picture, PICTURE_QUALITY),
        layers="\n".join([*layers, *_smears(estimate), *_epipoles(estimate)]),
        legend="\n".join(_legend(estimate, mask)),
        facts="\n".join(_facts(one)),
        file=escape(one.name.replace("/", "_") + ".json"),
        json=_uri("application/json", one.to_json().encode("utf-8", "surrogateescape")),
    )


def thumbnail(estimate: Estimate, image: AnyArray) -> str:
    """Return the data URI of a small picture of a photograph with its smears."""
    return _jpeg(draw_smears(image, estimate, THUMBNAIL_SIDE_PX), THUMBNAIL_QUALITY)


def report(entries: Sequence[tuple[Photograph, str, str]], version: str) -> bytes:
    """Return the page, UTF-8, of records with their `section` and `thumbnail`, both empty if they failed.

    Equal entries give equal bytes. A Content-Security-Policy forbids the page to load anything, and to run
    other scripts than its own.
    """
    style, script = _part("page.css"), _part("page.js")
    failed = sum(bool(one.error) for one, _, _ in entries)
    counts = f"{len(entries)} photograph{'s' * (len(entries) != 1)}" + f", {failed} failed" * bool(failed)
    sections = [text.replace("@NUMBER@", str(k)) for k, (_, text, _) in enumerate(entries)]
    page = Template(_part("page.html")).substitute(
        title=escape(entries[0][0].name if len(entries) == 1 else counts),
        summary=counts,
        version=escape(version),
        style=style,
        style_hash=_hash(style),
        script=script,
        script_hash=_hash(script),
        index="\n".join(_row(k, one, small) for k, (one, _, small) in enumerate(entries)),
        photographs="\n".join(sections),
    )
    return page.encode("utf-8", "backslashreplace")  # a file name may hold bytes that are no text


def _row(number: int, one: Photograph, small: str) -> str:
    """Return the line of a photograph in the index."""
    if one.error:
        return f'<tr class="failed"><td>{escape(one.name)}</td><td colspan="4">{escape(one.error)}</td></tr>'
    numbers = ("" if value is None else f"{value:.3g}" for value in (one.smear_px, one.smear_percent))
    picture = f'<img src="{small}" alt="">' if small else ""
    link = f'<a href="#photo-{number}">{picture}{escape(one.name)}</a>'
    return f"<tr>{_cells([link, escape(one.verdict), escape(one.blur), *numbers])}</tr>"


def _facts(one: Photograph) -> Iterable[str]:
    """Yield the table of what the record says beside the picture; a row's title explains it."""
    for name, _, text in entries():
        value = getattr(one, name)
        if name in ELSEWHERE or value is None or value is False or value == "" or isinstance(value, dict):
            continue
        shown = f"{value:.4g}" if isinstance(value, float) else str(value)
        if isinstance(value, list):  # a matrix
            shown = "\n".join(", ".join(f"{one:.4g}" for one in row) for row in value)
        label = "width_px, of the blur" if name == "width_px" else name
        yield f'<tr title="{escape(text)}"><td>{label}</td><td>{escape(shown)}</td></tr>'


def _legend(estimate: Estimate, mask: MotionMask | None) -> Iterable[str]:
    """Yield what the layers show, each sentence of the class of its layer, and how to move the picture."""
    geometry, fits, drawn = estimate.geometry, estimate.geometry.inlier_mask, drawn_smears(estimate)
    explained = geometry.F is not None or geometry.H is not None
    coloured = "Coloured lines are smears that fit the geometry, each direction in its colour. "
    grey = f"Grey ones {'do not' if explained else 'are smears that no geometry explains'}. "
    words = coloured * bool((fits & drawn).any()) + grey * bool((~fits & drawn).any())
    if words:
        lines = " and its epipolar line" * _has_lines(estimate)
        yield f'<p class="legend of-smears">{words}The pointer over one shows its figures{lines}.</p>'
    if _has_lines(estimate):
        yield '<p class="legend of-lines">White lines are epipolar lines, a ring is an epipole.</p>'
    low, high = np.exp(_uncertainty_range(estimate))
    scale = f"from {rounded(low)} px, violet, to {rounded(high)} px, yellow"
    yield f'<p class="legend of-uncertainty">Uncertainty is the standard deviation of a smear, {scale}.</p>'
    if mask is not None and (mask.labels == MotionLabel.STATIC).all():
        yield '<p class="legend">No mover found.</p>'
    elif mask is not None:
        pink = "Pink moves by itself. " * bool((mask.labels == MotionLabel.MOVING).any())
        dark = "Where the picture is dark motion cannot be seen." * bool(
            (mask.labels == MotionLabel.UNOBSERVABLE).any()
        )
        yield f'<p class="legend of-mask">{pink}{dark}</p>'
    yield '<p class="legend">Ctrl and the wheel zoom, a drag moves the picture.</p>'


def _has_lines(estimate: Estimate) -> bool:
    """Return whether smears have epipolar lines here: those of a lens with distortion would be curves."""
    straight = estimate.camera is None or not estimate.camera.distorted
    return straight and len(estimate.matches) > 0 and lines_of(estimate.geometry) is not None


def _smears(estimate: Estimate) -> Iterable[str]:
    """Yield the smears that were used, outliers first, each with its epipolar line and its figures."""
    matches, geometry, F = estimate.matches, estimate.geometry, lines_of(estimate.geometry)
    lines = None
    if F is not None and _has_lines(estimate):
        lines = epipolar_lines(F, matches, geometry.second_end_is_open)
    distance = None if lines is None or F is None else np.sqrt(serrmin(F, matches.ends))
    colours = orientation_colours(matches.displacement)
    reach = float(np.hypot(*estimate.grid.size))
    inliers = np.flatnonzero(geometry.inlier_mask)
    spacing = (np.prod(estimate.grid.size) / SQUARES) ** 0.5
    some = set(
        inliers[spread_subset(matches.midpoint[inliers], matches.length_px[inliers], spacing)].tolist()
    )
    drawn = drawn_smears(estimate)
    for k in sorted(range(len(matches)), key=lambda k: bool(geometry.inlier_mask[k])):
        if not drawn[k]:
            continue
        ends, fits = matches.ends[k], bool(geometry.inlier_mask[k])
        colour = "" if not fits else f' stroke="rgb{tuple(colours[k].tolist())}"'
        angle = np.degrees(np.arctan2(*matches.displacement[k][::-1])) % 180
        words = f"{matches.length_px[k]:.1f} px, deviation {matches.sigma_px[k]:.1f} px, {angle:.0f} degrees"
        line = ""
        if lines is not None and distance is not None:
            words += f"; {distance[k]:.2f} px from its epipolar line"
            foot, along = lines[0][k], lines[1][k]
            chosen = " some" if k in some else ""
            line = _line(np.stack([foot - reach * along, foot + reach * along]), f"line{chosen}")
        kind = "smear" if fits else "smear outlier"
        yield f"<g><title>{words}</title>{_line(ends, 'touch')}{line}{_line(ends, kind, colour)}</g>"


def _line(ends: AnyArray, kind: str, more: str = "") -> str:
    (x1, y1), (x2, y2) = ends.round(2).tolist()
    return f'<line class="{kind}" x1="{x1:g}" y1="{y1:g}" x2="{x2:g}" y2="{y2:g}"{more}/>'


def _epipoles(estimate: Estimate) -> Iterable[str]:
    F = lines_of(estimate.geometry)
    radius = 0.012 * max(estimate.grid.size)
    for x, y in [] if F is None else epipoles_within(F, estimate.grid.size):
        yield f'<circle class="epipole" cx="{x:.1f}" cy="{y:.1f}" r="{radius:.1f}"/>'


def _uncertainty(estimate: Estimate) -> str:
    """Return the map of the smears' deviations, on a logarithmic scale, as a picture of one pixel a cell."""
    grid = estimate.grid
    logs = _log_deviations(estimate)
    low, high = _uncertainty_range(estimate)
    levels = np.round(255 * np.clip((logs - low) / (high - low), 0, 1)).astype(np.uint8)
    colours = cv2.applyColorMap(levels, cv2.COLORMAP_VIRIDIS)[..., ::-1]
    height, width = grid.stride * np.array(levels.shape)
    return _image(_png(colours), "uncertainty", width, height)


def _log_deviations(estimate: Estimate) -> AnyArray:
    return np.log(np.maximum(estimate.grid.smears().sigma_px, 1e-3))


def _uncertainty_range(estimate: Estimate) -> tuple[float, float]:
    """Return the logarithms of the deviations, pixels, that the lowest and highest colour stand for."""
    low, high = np.percentile(_log_deviations(estimate), [2, 98]).tolist()
    return low, max(high, low + 0.1)


def _mask(mask: MotionMask) -> Iterable[str]:
    """Yield what moves, pink, and where nothing can be seen, dark, if there is either."""
    if (mask.labels == MotionLabel.STATIC).all():
        return
    height, width = mask.labels.shape
    scale = min(1.0, MASK_SIDE_PX / max(height, width))
    size = max(round(width * scale), 1), max(round(height * scale), 1)
    labels = cv2.resize(mask.labels, size, interpolation=cv2.INTER_NEAREST)
    colours = np.zeros((*labels.shape, 4), np.uint8)
    colours[labels == MotionLabel.MOVING] = MOVING_RGBA
    colours[labels == MotionLabel.UNOBSERVABLE] = UNSEEN_RGBA
    yield _image(_png(colours), "mask", width, height)


def _image(uri: str, kind: str, width: int, height: int) -> str:
    size = f'x="-0.5" y="-0.5" width="{width}" height="{height}" preserveAspectRatio="none"'
    return f'<image class="{kind}" href="{uri}" {size}/>'


def _cells(cells: Iterable[str]) -> str:
    return "".join(f"<td>{cell}</td>" for cell in cells)


def _part(name: str) -> str:
    return (files("blur2view.results") / "page" / name).read_text("utf-8")


def _hash(text: str) -> str:
    """Return the source expression by which a Content-Security-Policy allows exactly this text."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


def _uri(kind: str, content: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"


def _png(picture: AnyArray) -> str:
    return _uri("image/png", png(picture))


def _jpeg(picture: AnyArray, quality: int) -> str:
    file = BytesIO()
    Image.fromarray(picture).save(file, "JPEG", quality=quality, subsampling=0)
    return _uri("image/jpeg", file.getvalue())
