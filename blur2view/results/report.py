"""The report: one HTML file that holds everything, loads nothing and runs nothing.

A photograph is a section of the page: its picture under layers, which checkboxes show and hide, and what its
record says. An index with small pictures is ordered by name, smear or verdict, which needs no script. Failed
ones have a line of the index with their reason.
"""

import base64
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from html import escape
from itertools import groupby
from posixpath import dirname
from typing import Any, NamedTuple

import cv2
import numpy as np

from blur2view.arrays import AnyArray
from blur2view.movers.mask import MotionMask
from blur2view.pipeline import Estimate
from blur2view.records.record import Record, entries
from blur2view.records.verdict import turned
from blur2view.results.blur_timeline import STYLE as SVG_STYLE
from blur2view.results.blur_timeline import Seen, smears_over_time, turning_over_time
from blur2view.results.overlay import Picture, line_layer, mask_layer, picture_size, shown, smear_layer
from blur2view.results.page import page

SIDE_PX, THUMBNAIL_PX = 960, 96  # bounds of the longer side of pictures; the page shows them as large
QUALITY, LAYER_QUALITY, LOSSLESS = 75, 40, 101  # of WebP
LEVELS = (6, 6, 6, 16)  # of red, green, blue and opacity, in layers of lines and of what moves
MIN_FRAMES = 3  # of a video, whose blur is shown over time
ELSEWHERE = ("name", "verdict", "models", "model_ids", "input_sha256", "options_sha256", "files_sha256")
LAYERS = {
    "smears": ("smears", "Smears that fit the geometry are coloured by direction; others are grey."),
    "lines": ("epipolar lines", "White lines are epipolar lines, and rings are epipoles."),
    "moves": ("what moves", "What moves by itself is pink; motion cannot be seen where it is dark."),
    "errors": ("uncertainty", "Standard deviations of the smears: violet is small, and yellow is large."),
}
STYLE = """
:root { color-scheme: light dark; font: 15px/1.45 system-ui, sans-serif; }
body { max-width: 1280px; margin: auto; padding: 12px 20px; }
th, td { text-align: left; padding: 2px 14px 2px 0; vertical-align: top; overflow-wrap: anywhere; }
th, small { font-weight: normal; color: GrayText; }
th { white-space: nowrap; }
td:first-child { min-width: 14em; }
td { white-space: pre-line; font-variant-numeric: tabular-nums; }
article { margin-top: 40px; border-top: 2px solid; content-visibility: auto; contain-intrinsic-size: 1400px; }
ol { display: flex; flex-direction: column; padding: 0; }
li { display: flex; gap: 14px; align-items: center; order: var(--name); margin: 2px 0; }
li span { flex: 0 0 96px; }
li img { width: auto; max-width: 96px; max-height: 72px; }
li a { flex: 0 1 22em; overflow-wrap: anywhere; }
li b { font-weight: normal; flex: 1; }
body:has(input.smear:checked) li { order: var(--smear); }
body:has(input.verdict:checked) li { order: var(--verdict); }
article table { font-size: 13px; }
h2 { font-size: 15px; font-weight: normal; margin: 8px 0 0; overflow-wrap: anywhere; }
h3 { font-size: 21px; font-weight: normal; margin: 0 0 8px; }
figure { position: relative; margin: 8px 0; max-width: 960px; }
img { display: block; width: 100%; height: auto; }
img + img { position: absolute; top: 0; height: 100%; }
label { margin-right: 16px; }
@media print { article { break-before: page; border: 0; margin: 0; } tr { break-inside: avoid; } }
""" + "".join(f"article:has(input.{name}:not(:checked)) img.{name} {{ display: none; }}\n" for name in LAYERS)


class Section(NamedTuple):
    """The part of the page that shows one photograph, and its picture in the index, both HTML."""

    html: str
    thumbnail: str


def section(record: Record, estimate: Estimate, image: AnyArray, mask: MotionMask | None = None) -> Section:
    """Return the part of a photograph: its verdict, its picture under layers, its record.

    ``image`` (H, W, 3) is the photograph as it was estimated, ``mask`` its motion mask, if it was asked for.
    """
    layers = {"smears": smear_layer(estimate), "lines": line_layer(estimate)}
    layers |= {} if mask is None else {"moves": mask_layer(mask)}
    layers |= {"errors": _uncertainty(estimate)}
    layers = {name: layer for name, layer in layers.items() if layer.any()}
    boxes, words, pictures = "", "", ""
    for name, layer in layers.items():
        title, text = LAYERS[name]
        checked = " checked" if name == "smears" else ""
        boxes += f'<label><input type="checkbox" class="{name}"{checked}> {title}</label>'
        words += f" {text}"
        drawn = _straight(_reduced(layer, SIDE_PX))
        uri = _webp(drawn if name == "errors" else _in_few_levels(drawn), LAYER_QUALITY)
        pictures = f'<img class="{name}" src="{uri}" alt="{title}">{pictures}'  # the first lies on top
    photograph = _reduced(shown(image), SIDE_PX)
    height, width = photograph.shape[:2]
    uri = _webp(photograph, QUALITY)
    json = data_uri("application/json", record.to_json().encode("utf-8", "surrogateescape"))
    html = f"""<h2>{escape(record.name)}, {record.width} x {record.height} pixels</h2>
<h3>{escape(record.verdict)}</h3>
{boxes}
<figure><img src="{uri}" alt="{escape(record.name)}" width="{width}" height="{height}">{pictures}</figure>
<small>{words}</small>
<table>{"".join(_facts(record))}</table>
<p><a download="{escape(record.name.replace("/", "_"))}.json" href="{json}">JSON of this photograph</a></p>"""
    return Section(html, _webp(_reduced(photograph, THUMBNAIL_PX), QUALITY))


def report(photographs: Sequence[tuple[Record, Section | None]], version: str) -> bytes:
    """Return the page, UTF-8, of records with their `section`, None of those that failed.

    Equal records give equal bytes.
    """
    failed, count = sum(bool(record.error) for record, _ in photographs), len(photographs)
    counts = "1 photograph" if count == 1 else f"{count} photographs"
    if failed:
        counts += f", {failed} failed"
    ranks, rows, articles = _ranks([record for record, _ in photographs]), "", ""
    for k, (record, part) in enumerate(photographs):
        style = ";".join(f"--{order}:{rank[k]}" for order, rank in ranks.items())
        link = f'<a href="#photo-{k}">{escape(record.name)}</a>' if part else escape(record.name)
        small = f'<img src="{part.thumbnail}" alt="">' if part else ""
        rows += f'<li style="{style}"><span>{small}</span>{link}<b>{escape(record.verdict)}</b></li>\n'
        articles += f'<article id="photo-{k}">\n{part.html}\n</article>' if part else ""
    orders = ""
    for order in ranks if count > 1 else ():
        checked = " checked" if order == "name" else ""
        orders += f'<label><input type="radio" name="order" class="{order}"{checked}> {order}</label>'
    body = f"""<p><b>blur2view</b> report: {counts}</p>
{"".join(_timelines([record for record, _ in photographs]))}
<p>{f"in the order of {orders}" if orders else ""}</p>
<ol>{rows}</ol>
{articles}"""
    title = photographs[0][0].name if count == 1 else counts
    return page(title, body, style=SVG_STYLE + STYLE, version=version)


def _timelines(records: Sequence[Record]) -> Iterator[str]:
    """Yield the pictures of each video's blur over time, whose marks link to the frames."""
    frames = [
        (k, record) for k, record in enumerate(records) if record.frame is not None and not record.error
    ]
    for video, several in groupby(frames, lambda one: dirname(one[1].name)):
        own = [(_seen(k, record), record) for k, record in several]
        if len(own) < MIN_FRAMES:
            continue
        unit = "rad/s" if own[0][1].exposure_s else "degrees"
        seen = [frame for frame, _ in own]
        yield f"<h2>Blur over time: {escape(video)}</h2>{smears_over_time(seen)}"
        if turning := turning_over_time(seen, unit):
            yield f"<h2>How the camera turned, with its standard deviation</h2>{turning}"


def _seen(place: int, record: Record) -> Seen:
    """Return a frame for the timeline; it links to its section."""
    scale = 1.0 if record.exposure_s else math.degrees(1)
    angle, sigma = turned(record)
    return Seen(
        name=record.name,
        number=record.frame or 0,
        kind=record.blur,
        smear_px=record.smear_px,
        turned=None if record.wx is None else (scale * angle, scale * sigma),
        link=f"#photo-{place}",
    )


def _ranks(records: Sequence[Record]) -> dict[str, list[int]]:
    """Return the rank of each photograph in the orders of the index; those that failed come last."""
    keys: dict[str, Callable[[Record], tuple[Any, ...]]] = {
        "name": lambda record: (),  # as they were named
        "smear": lambda record: (-(record.smear_px or 0.0),),
        "verdict": lambda record: (record.verdict,),
    }
    ranks = {order: [0] * len(records) for order in keys}
    for order, key in keys.items():
        numbers = sorted(range(len(records)), key=lambda k: (bool(records[k].error), key(records[k])))
        for rank, k in enumerate(numbers):
            ranks[order][k] = rank
    return ranks


def _facts(record: Record) -> Iterable[str]:
    """Yield a table row for every field beside the picture, with its explanation as title."""
    for name, _, text in entries():
        value = getattr(record, name)
        if name in ELSEWHERE or value is None or value is False or value == "" or isinstance(value, dict):
            continue
        said = f"{value:.4g}" if isinstance(value, float) else str(value)
        if isinstance(value, list):  # a matrix
            said = "\n".join(", ".join(f"{number:.4g}" for number in row) for row in value)
        yield f'<tr title="{escape(text)}"><th>{name}</th><td>{escape(said)}</td></tr>\n'


def _uncertainty(estimate: Estimate) -> Picture:
    """Return the layer of the smears' standard deviations, on a logarithmic scale."""
    grid = estimate.grid
    sigma = np.log(np.maximum(grid.smears().sigma_px, 1e-3))
    low, high = np.percentile(sigma, [2, 98])
    levels = np.round(255 * np.clip((sigma - low) / max(high - low, 0.1), 0, 1)).astype(np.uint8)
    pixels = np.kron(levels, np.ones((grid.stride, grid.stride), np.uint8))[: grid.shape[0], : grid.shape[1]]
    small = cv2.resize(pixels, picture_size(grid.shape), interpolation=cv2.INTER_NEAREST)
    colours = cv2.applyColorMap(small, cv2.COLORMAP_VIRIDIS)[..., ::-1]
    return (0.65 * np.dstack([colours, np.full(small.shape, 255)])).astype(np.uint8)


def _straight(layer: Picture) -> Picture:
    """Return a layer as PNG stores it: its colours not multiplied by its opacity."""
    colours = layer[..., :3] * np.float32(255) / np.maximum(layer[..., 3:], 1)
    return np.dstack([np.minimum(colours, 255).round().astype(np.uint8), layer[..., 3]])


def _reduced(picture: Picture, side: int) -> Picture:
    """Return a picture that is no longer than this."""
    scale = side / max(picture.shape)
    if scale >= 1:
        return picture
    return np.asarray(cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.uint8)


def _in_few_levels(layer: Picture) -> Picture:
    """Return a layer of plain colours in `LEVELS` of each channel, for smaller WebP pictures."""
    steps = np.rint(255 / (np.array(LEVELS) - 1)).astype(np.float32)
    levels = (np.rint(layer / steps) * steps).astype(np.uint8)
    levels[levels[..., 3] == 0] = 0
    return levels


def _webp(picture: Picture, quality: int) -> str:
    """Return a picture, RGB or RGBA, as WebP in a data URI, a layer without loss where that is smaller."""
    order = [2, 1, 0, 3][: picture.shape[2]]
    pixels = np.ascontiguousarray(picture[..., order])
    ways = (quality, LOSSLESS) if len(order) == 4 else (quality,)
    encoded = (cv2.imencode(".webp", pixels, (cv2.IMWRITE_WEBP_QUALITY, way))[1] for way in ways)
    return data_uri("image/webp", min((one.tobytes() for one in encoded), key=len))


def data_uri(kind: str, content: bytes) -> str:
    """Return content as a data URI of a media type."""
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"
