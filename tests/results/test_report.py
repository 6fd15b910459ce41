"""The report: one page that loads and runs nothing, and says what the records say."""

import base64
import io
import re

import numpy as np
from PIL import Image

from blur2view.results.photograph import Photograph
from blur2view.results.report import report, section
from tests.support.report_scenes import boxed_mask, made_up, turning_F

NAME = "folder/<b>photo & more.png"
FAILED = Photograph(name="b.jpg", error="b.jpg: is no <picture>")


def page_of(*, F: bool = True, mask: bool = False, again: int = 1) -> tuple[Photograph, str]:
    """Return a record, and the page of it."""
    estimate, image = made_up(F=turning_F() if F else None)
    one = Photograph.of(estimate, name=NAME)
    text = section(one, estimate, image, boxed_mask() if mask else None)
    return one, report([(one, text)] * again, "1.2").decode()


def test_the_page_loads_and_runs_nothing_and_names_are_text() -> None:
    page = page_of(mask=True)[1]
    assert "default-src 'none'; img-src data:; style-src 'unsafe-inline'" in page and "<script" not in page
    places = re.findall(r'(?:href|src)="([^"]*)"', page)
    assert places and all(place.startswith(("data:", "#")) for place in places)
    assert "<b>photo" not in page and page_of(mask=True)[1] == page  # equal records give equal bytes


def test_it_says_what_the_record_says() -> None:
    one, page = page_of(again=2)
    assert page.count(f">{one.verdict}<") == 4  # in the index and above the picture
    assert 'id="photo-0"' in page and 'href="#photo-1"' in page
    assert f"<th>num_inliers</th><td>{one.num_inliers}</td>" in page
    link = re.search(r'download="[^"]+" href="data:application/json;base64,([^"]+)"', page)
    assert link is not None and Photograph.from_json(base64.b64decode(link[1])) == one
    page = report([(one, ""), (FAILED, "")], "1.2").decode()
    assert "2 photographs, 1 failed" in page and "b.jpg: is no &lt;picture&gt;" in page


def test_layers_are_pictures_of_one_size_that_checkboxes_show_and_words_explain() -> None:
    page = page_of(mask=True)[1]
    layers = re.findall(r'<img class="(\w+)" src="data:image/png;base64,([^"]+)"', page)
    assert [name for name, _ in layers] == ["errors", "moves", "lines", "smears"]
    pictures = [np.asarray(Image.open(io.BytesIO(base64.b64decode(content)))) for _, content in layers]
    assert {one.shape for one in pictures} == {(360, 640, 4)}
    opacity = {name: one[..., 3] for (name, _), one in zip(layers, pictures, strict=True)}
    assert opacity["moves"][110, 150] and not opacity["moves"][300, 50] and (opacity["errors"] > 0).all()
    for name in opacity:
        assert f'type="checkbox" class="{name}"' in page and f"input.{name}:not(:checked)" in page
    for words in ("Smears: coloured", "White lines", "Pink moves", "Uncertainty: "):
        assert f" {words}" in page.replace("<small>", " ")
    without = page_of(F=False)[1]
    assert 'class="lines"' not in without and 'class="moves"' not in without
