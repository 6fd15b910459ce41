"""The report: one HTML file with everything in it, that shows the results of many photographs."""

import base64
import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from importlib.resources import files
from pathlib import PurePath
from string import Template

from blur2view.pipeline import FileEstimate
from blur2view.results.overlay import draw_smears
from blur2view.results.report_pack import THUMBNAIL_QUALITY, THUMBNAIL_SIDE_PX, photograph, picture
from blur2view.results.verdicts import VERDICT_ORDER
from blur2view.segmentation.mask import MotionMask

SCRIPTS = ["unpack", "geometry", "lens", "colours", "smears", "layers", "view", "values"]
SCRIPTS += ["viewer", "gestures", "gallery", "main"]
STYLES = ("page", "stage")


@dataclass(frozen=True, kw_only=True)
class Entry:
    """One photograph of a report, as text that goes into the page."""

    name: str  # its path without the folders that say where the user keeps it
    kind: str  # of verdict, see `verdicts.KINDS`, or "failed"
    verdict: str  # the configuration, or "FAILED"
    text: str  # one sentence on what the verdict means, or the error
    median_px: float | None = None  # length of the smears that were used
    thumbnail: str = ""  # data URI of the photograph with its smears; empty for a failed one
    content: str = ""  # JSON of `report_pack.photograph`; empty for a failed one

    @classmethod
    def of(cls, one: FileEstimate, mask: MotionMask | None = None, mask_s: float | None = None) -> "Entry":
        """Return the entry of a photograph that was estimated; see `report_pack.photograph`."""
        shown = photograph(one, mask, mask_s)
        matches, geometry = one.estimate.matches, one.estimate.geometry
        drawn = draw_smears(one.image, one.estimate.grid, matches, geometry, THUMBNAIL_SIDE_PX)
        return cls(
            name=shown["name"],
            kind=shown["kind"],
            verdict=geometry.config.name,
            text=shown["meaning"],
            median_px=shown["median_px"],
            thumbnail=picture(drawn, THUMBNAIL_SIDE_PX, THUMBNAIL_QUALITY),
            content=json.dumps(shown, allow_nan=False),
        )

    @classmethod
    def failed(cls, name: str, error: str) -> "Entry":
        """Return the entry of a photograph that could not be estimated."""
        return cls(name=name, kind="failed", verdict="FAILED", text=error)


def report(entries: Sequence[Entry], version: str) -> bytes:
    """Return the page, UTF-8, of entries in the order of the call; equal entries give equal bytes.

    It loads nothing: a Content-Security-Policy forbids it, and scripts other than ours.
    """
    style = "\n".join(_part(f"{name}.css") for name in STYLES)
    script = '"use strict";\n(() => {\n' + "\n".join(_part(f"{name}.js") for name in SCRIPTS) + "})();\n"
    blocks = [_block(f"photo-data-{k}", one.content) if one.content else "" for k, one in enumerate(entries)]
    failures = [{"image": one.name, "error": one.text} for one in entries if not one.content]
    proven, failed = sum(one.kind == "proven" for one in entries), len(failures)
    counts = f"{len(entries)} photograph{'s' * (len(entries) != 1)}, {proven} with proven parallax"
    page = Template(_part("page.html")).substitute(
        title=escape(entries[0].name if len(entries) == 1 else f"{len(entries)} photographs"),
        summary=counts + f", {failed} failed" * bool(failed),
        version=escape(version),
        style=style,
        style_hash=_hash(style),
        script=script,
        script_hash=_hash(script),
        cards="\n".join(_card(index, entry) for index, entry in enumerate(entries)),
        contents="\n".join(blocks),
        failures=_block("failures", json.dumps(failures, allow_nan=False)),
    )
    return page.encode("utf-8", "backslashreplace")  # a file name may hold bytes that are no text


def _part(name: str) -> str:
    return (files("blur2view.results") / "report_page" / name).read_text("utf-8")


def _hash(text: str) -> str:
    """Return the source expression by which a Content-Security-Policy allows exactly this text."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


def _card(index: int, entry: Entry) -> str:
    """Return the photograph's card in the gallery, readable without any script."""
    median, done = entry.median_px, bool(entry.content)
    words = "no smears" if median is None else f"used: median {median:.1f} px"
    return Template(_part("card.html")).substitute(
        index=index,
        kind=escape(entry.kind),
        name=escape(entry.name),
        short=escape(PurePath(entry.name).name),
        text=escape(entry.text),
        verdict=escape(entry.verdict),
        order=VERDICT_ORDER.index(entry.verdict) if done else len(VERDICT_ORDER),
        length="" if median is None else f"{median:.6g}",
        words=words * done,
        picture=f'<img src="{escape(entry.thumbnail)}" alt="" decoding="async">' * done,
        tag=f'a class="card-body" href="#photo-{index}"' if done else 'div class="card-body"',
        end="a" if done else "div",
    )


def _block(name: str, text: str) -> str:
    """Return JSON as a block of data that nothing in it can end: angle brackets are written as escapes."""
    safe = text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")
    return f'<script type="application/json" id="{name}">{safe}</script>'
