"""An HTML page that holds everything, loads nothing but pictures in itself, and runs nothing."""

from html import escape

from blur2view.output import SIGNED_BY

POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'"
"""The Content-Security-Policy, which forbids all else to whatever a name may smuggle in."""


def page(title: str, body: str, *, style: str, version: str) -> bytes:
    """Return the page, UTF-8, of a ``body`` in HTML and a ``style`` in CSS; the title is text."""
    text = f"""<!doctype html>
<html lang="en">
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{POLICY}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="generator" content="{SIGNED_BY} {escape(version)}">
<title>{escape(title)} - blur2view</title>
<link rel="icon" href="data:,">
<style>{style}</style>
{body}
</html>
"""
    return text.encode("utf-8", "backslashreplace")  # a file name may hold bytes that are no text
