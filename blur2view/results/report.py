"""The report: one HTML file that holds everything, loads nothing and runs nothing.

A photograph is a section of the page: its picture under layers, which checkboxes show and hide, and what its
record says. Failed ones have a line of the index with their reason.
"""

import base64
from collections.abc import Iterable, Sequence
from html import escape

import cv2
import numpy as np

from blur2view.arrays import AnyArray
from blur2view.movers.mask import MotionMask
from blur2view.pipeline import Estimate
from blur2view.results.overlay import Picture, line_layer, mask_layer, png, shown, size_of, smear_layer
from blur2view.results.record import Record, entries

JPEG = (cv2.IMWRITE_JPEG_QUALITY, 90)  # a 1280x720 street has 160 kB
ELSEWHERE = ("name", "verdict", "models", "model_ids", "input_sha256", "options_sha256", "files_sha256")
LAYERS = {
    "smears": ("smears", "Smears: coloured by direction those that fit the geometry, grey others."),
    "lines": ("epipolar lines", "White lines are epipolar lines, rings epipoles."),
    "moves": ("what moves", "Pink moves by itself; where it is dark motion cannot be seen."),
    "errors": ("uncertainty", "Uncertainty: standard deviations of smears, violet small, yellow large."),
}
STYLE = """
:root { color-scheme: light dark; font: 15px/1.45 system-ui, sans-serif; }
body { max-width: 1280px; margin: auto; padding: 12px 20px; }
th, td { text-align: left; padding: 2px 14px 2px 0; vertical-align: top; overflow-wrap: anywhere; }
th, small { font-weight: normal; color: GrayText; }
th { white-space: nowrap; }
td:first-child { min-width: 14em; }
td { white-space: pre-line; font-variant-numeric: tabular-nums; }
article { margin-top: 40px; border-top: 2px solid; }
article table { font-size: 13px; }
h2 { font-size: 15px; font-weight: normal; margin: 8px 0 0; overflow-wrap: anywhere; }
h3 { font-size: 21px; font-weight: normal; margin: 0 0 8px; }
figure { position: relative; margin: 8px 0; }
img { display: block; width: 100%; }
img + img { position: absolute; top: 0; height: 100%; }
label { margin-right: 16px; }
""" + "".join(f"article:has(input.{name}:not(:checked)) img.{name} {{ display: none; }}\n" for name in LAYERS)


def section(record: Record, estimate: Estimate, image: AnyArray, mask: MotionMask | None = None) -> str:
    """Return the HTML of a photograph: its verdict, its picture under layers, its record.

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
        uri = _uri("image/png", png(_straight(layer)))
        pictures = f'<img class="{name}" src="{uri}" alt="{title}">{pictures}'  # the first lies on top
    jpeg = cv2.imencode(".jpg", shown(image)[..., ::-1], JPEG)[1].tobytes()
    json = _uri("application/json", record.to_json().encode("utf-8", "surrogateescape"))
    return f"""<h2>{escape(record.name)}, {record.width} x {record.height} pixels</h2>
<h3>{escape(record.verdict)}</h3>
{boxes}
<figure><img src="{_uri("image/jpeg", jpeg)}" alt="{escape(record.name)}">{pictures}</figure>
<small>{words}</small>
<table>{"".join(_facts(record))}</table>
<p><a download="{escape(record.name.replace("/", "_"))}.json" href="{json}">JSON of this photograph</a></p>"""


def report(photographs: Sequence[tuple[Record, str]], version: str) -> bytes:
    """Return the page, UTF-8, of records with their `section`, which is empty if they failed.

    Equal records give equal bytes. A Content-Security-Policy forbids the page to load or run anything.
    """
    failed, count = sum(bool(record.error) for record, _ in photographs), len(photographs)
    counts = "1 photograph" if count == 1 else f"{count} photographs"
    if failed:
        counts += f", {failed} failed"
    rows, articles = "", ""
    for k, (record, text) in enumerate(photographs):
        link = f'<a href="#photo-{k}">{escape(record.name)}</a>' if text else escape(record.name)
        rows += f"<tr><td>{link}</td><td>{escape(record.verdict)}</td></tr>"
        articles += f'<article id="photo-{k}">\n{text}\n</article>' if text else ""
    policy = (
        "default-src 'none'; img-src data:; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'"
    )
    page = f"""<!doctype html>
<html lang="en">
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="generator" content="blur2view {escape(version)}">
<title>{escape(photographs[0][0].name if count == 1 else counts)} - blur2view</title>
<link rel="icon" href="data:,">
<style>{STYLE}</style>
<p><b>blur2view</b> report: {counts}</p>
<table>{rows}</table>
{articles}
</html>
"""
    return page.encode("utf-8", "backslashreplace")  # a file name may hold bytes that are no text


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
    small = cv2.resize(pixels, size_of(grid.shape), interpolation=cv2.INTER_NEAREST)
    colours = cv2.applyColorMap(small, cv2.COLORMAP_VIRIDIS)[..., ::-1]
    return (0.65 * np.dstack([colours, np.full(small.shape, 255)])).astype(np.uint8)


def _straight(layer: Picture) -> Picture:
    """Return a layer as PNG stores it: its colours not multiplied by its opacity."""
    colours = layer[..., :3] * np.float32(255) / np.maximum(layer[..., 3:], 1)
    return np.dstack([np.minimum(colours, 255).round().astype(np.uint8), layer[..., 3]])


def _uri(kind: str, content: bytes) -> str:
    """Return content as a data URI of a media type."""
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"
