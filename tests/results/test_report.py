"""The report: one page that loads nothing, and says what the records say."""

import base64
import re
from xml.etree import ElementTree

import pytest

from blur2view.results.photograph import Photograph
from blur2view.results.report import report, section, thumbnail
from tests.support.report_scenes import HEIGHT, WIDTH, boxed_mask, made_up, turning_F

NAME = "folder/<b>photo & more.png"


def page_of(*, F: bool = True, mask: bool = False, again: int = 1) -> tuple[Photograph, str]:
    """Return a record, and the page of it."""
    estimate, image = made_up(F=turning_F() if F else None)
    one = Photograph.of(estimate, name=NAME)
    text = section(one, estimate, image, boxed_mask() if mask else None)
    return one, report([(one, text, thumbnail(estimate, image))] * again, "1.2").decode()


def test_the_page_loads_nothing_and_runs_its_own_script_alone() -> None:
    _, page = page_of()
    assert re.search("default-src 'none'; img-src data:; script-src 'sha256-[^']+'; style-src 'sha256-", page)
    places = re.findall(r'(?:href|src)="([^"]*)"', page)
    assert places and all(place.startswith(("data:", "#")) for place in places)
    assert "<b>photo" not in page and page_of()[1] == page  # names are text; equal records give equal bytes


def test_it_says_what_the_record_says() -> None:
    one, page = page_of()
    assert page.count(one.verdict) == 2  # in the index and above the picture
    assert f"<td>num_inliers</td><td>{one.num_inliers}</td>" in page
    assert "<td>num_inliers</td><td>0</td>" in page_of(F=False)[1]  # which is a value
    link = re.search(r'download="[^"]+" href="data:application/json;base64,([^"]+)"', page)
    assert link is not None and Photograph.from_json(base64.b64decode(link[1])) == one


@pytest.mark.parametrize("F", [True, False])
def test_every_smear_that_was_used_is_drawn_in_pixels_of_the_photograph(F: bool) -> None:
    one, page = page_of(F=F)
    svg = re.search(r"<svg.*?</svg>", page, re.DOTALL)
    assert svg is not None
    root = ElementTree.fromstring(svg[0])
    assert root.get("viewBox") == f"-0.5 -0.5 {WIDTH} {HEIGHT}"
    classes = [line.get("class", "").split()[0] for line in root.iter("line")]
    assert classes.count("line") == (one.num_matches if F else 0)
    inliers = [line for line in root.iter("line") if line.get("class") == "smear"]
    assert len(inliers) == (one.num_inliers if F else 0)


def test_what_was_not_asked_is_no_layer() -> None:
    assert 'class="mask"' in page_of(mask=True)[1] and 'class="mask"' not in page_of()[1]


def test_each_layer_that_shows_something_is_explained() -> None:
    page = page_of(mask=True)[1]
    for layer, words in (("smears", "Coloured lines"), ("lines", "White lines"), ("mask", "Pink")):
        assert f'<p class="legend of-{layer}">{words}' in page
    assert re.search(r"Uncertainty is .* from [0-9.]+ px, violet, to [0-9.]+ px, yellow", page)
    assert "of-lines" not in re.sub("<style>.*</style>", "", page_of(F=False)[1], flags=re.DOTALL)


def test_several_photographs_have_an_index_and_failed_ones_their_reason() -> None:
    one, page = page_of(again=2)
    assert 'id="photo-0"' in page and 'href="#photo-1"' in page
    failed = Photograph(name="b.jpg", error="b.jpg: is no <picture>")
    page = report([(one, "", ""), (failed, "", "")], "1.2").decode()
    assert "2 photographs, 1 failed" in page and "b.jpg: is no &lt;picture&gt;" in page
