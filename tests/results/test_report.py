"""The report's file: whole, small, the same every time, and nothing that a user names becomes markup."""

import base64
import hashlib
import json
import re
from functools import partial
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

from blur2view.cli.report import shown_names, without_folders
from blur2view.results.report import Entry, report
from tests.support.calls import Call
from tests.support.report_scenes import boxed_mask, made_up, turning_F

HOSTILE = '"><script>alert(1)</script><img src=x onerror=alert(2)>&amp;\u2028'


class _Markup(HTMLParser):
    """The elements of a page with their attributes, and its texts with the elements they lie in."""

    def __init__(self, page: bytes) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.texts: list[tuple[str, str]] = []
        self.inside = ""
        self.feed(page.decode())
        scripts = [text for tag, text in self.texts if tag == "script"]
        # blocks of data: the failures, then the photographs
        self.blocks: list[Any] = [json.loads(text) for text in scripts if text.startswith(("{", "["))]

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.inside = tag
        self.elements.append((tag, dict(attributes)))

    def handle_endtag(self, tag: str) -> None:
        self.inside = ""

    def handle_data(self, data: str) -> None:
        self.texts.append((self.inside, data))


@pytest.fixture
def page(tmp_path: Path) -> Path:
    """Return where the report is written."""
    return tmp_path / "page.html"


@pytest.fixture
def make(call: Call, page: Path) -> Call:
    """Return ``blur2view report`` with the tiny network, writing that page."""
    return partial(call, "report", "-o", page)


@pytest.mark.slow
def test_page_holds_what_estimate_prints(call: Call, make: Call, page: Path, moving: Path) -> None:
    done = make(moving)
    assert done == 0 and "moving.png: " in done.out and "page.html" in done.out
    (printed,) = call("estimate", "--json", moving).document["estimates"]
    _, shown = _Markup(page.read_bytes()).blocks
    document = json.loads(shown["document"])
    assert set(shown["seconds"]) == {"read", "predict", "select", "solve", "mask"}
    assert set(document.pop("timings_s")) == set(printed.pop("timings_s"))
    assert (document.pop("image"), printed.pop("image")) == ("moving.png", str(moving))
    assert document == printed
    assert shown["document"] == json.dumps(json.loads(shown["document"]), indent=2)
    assert make(moving, "--no-mask") == 0
    _, shown = _Markup(page.read_bytes()).blocks
    assert shown["mask"] is None and "mask" not in shown["seconds"]


@pytest.mark.slow
def test_same_call_gives_same_bytes(make: Call, page: Path, moving: Path) -> None:
    pages = []
    for seed in (0, 0, 5):
        assert make(moving, "--no-timings", "--overwrite", "--seed", seed) == 0
        pages.append(page.read_bytes())
    assert pages[0] == pages[1] != pages[2]


@pytest.mark.slow
def test_failure_is_a_card_not_the_end(make: Call, page: Path, moving: Path, tmp_path: Path) -> None:
    (broken := tmp_path / "broken.jpg").write_bytes(b"no picture")
    done = make(broken, moving, tmp_path / "absent.jpg")
    assert done == 1 and len(done.lines) == 2
    markup = _Markup(page.read_bytes())
    cards = [attributes for tag, attributes in markup.elements if tag == "li" and "data-index" in attributes]
    assert ["card-failed" in str(card["class"]) for card in cards] == [True, False, True]
    text = "".join(data for _, data in markup.texts)
    assert "is not a readable image" in text and "no such file" in text
    failures, photo = markup.blocks
    assert [Path(failure["image"]).name for failure in failures] == ["broken.jpg", "absent.jpg"]
    assert photo["name"] == "moving.png"
    assert str(tmp_path) not in page.read_text()


def test_names_in_a_report_hold_no_folders_of_the_user(tmp_path: Path) -> None:
    for name in ("a/x.jpg", "b/x.jpg"):
        (tmp_path / name).parent.mkdir()
        (tmp_path / name).touch()
    images = [tmp_path / "a/x.jpg", tmp_path / "b/x.jpg", Path("/secret/y.jpg")]
    assert list(shown_names(images).values()) == ["a/x.jpg", "b/x.jpg", "y.jpg"]
    assert shown_names(images[:1]) == {images[0]: "x.jpg"}
    line = f"{images[0]}: is of 9x9 pixels, in /home/me/project.db of 8x8; see /tmp or a/b"
    shown = without_folders(line, images[0], "x.jpg")
    assert shown == "x.jpg: is of 9x9 pixels, in project.db of 8x8; see /tmp or a/b"


@pytest.mark.slow
def test_nothing_is_written_if_every_photograph_fails(
    make: Call, page: Path, moving: Path, tmp_path: Path
) -> None:
    absent = tmp_path / "absent.jpg"
    assert make(absent) == 1 and not page.exists()
    assert make(absent, "-o", tmp_path / "new" / "page.html") == 1 and not (tmp_path / "new").exists()
    assert make(moving) == 0
    good = page.read_bytes()
    assert make(absent).line and page.read_bytes() == good
    done = make(absent, tmp_path / "none.jpg")
    assert done == 1 and page.read_bytes() == good
    assert "page.html: is not written" in done.lines[-1] and "wrote" not in done.out
    assert make(absent, moving) == 1 and page.read_bytes() != good


@pytest.mark.parametrize("name", [HOSTILE, "</script><script>alert(3)</script>", "\udcff.png", "$title"])
def test_names_and_errors_never_become_markup(name: str) -> None:
    entries = [Entry.of(made_up(name, F=turning_F())), Entry.failed(name, f"{name}: no such file")]
    markup = _Markup(report(entries, "1.0"))
    plain = _Markup(report([Entry.of(made_up(F=turning_F())), Entry.failed("a", "a: no such file")], "1.0"))
    assert [tag for tag, _ in markup.elements] == [tag for tag, _ in plain.elements]
    assert not any(key.startswith("on") for _, attributes in markup.elements for key in attributes)
    failures, photo = markup.blocks
    assert photo["name"] == str(Path(name)) and failures[0]["image"] == name
    text = "".join(data for _, data in markup.texts)
    readable = name.encode("utf-8", "backslashreplace").decode()
    assert f"{readable}: no such file" in text


def test_page_forbids_loading_and_foreign_scripts() -> None:
    page = report([Entry.of(made_up(F=turning_F()), boxed_mask())], "1.0")
    markup = _Markup(page)
    (policy,) = (
        str(a["content"]) for tag, a in markup.elements if a.get("http-equiv") == "Content-Security-Policy"
    )
    rules = dict(rule.strip().split(" ", 1) for rule in policy.split(";"))
    assert rules["default-src"] == "'none'" and rules["img-src"] == "data:"
    for tag, rule in (("script", "script-src"), ("style", "style-src")):
        text = [text for of, text in markup.texts if of == tag and not text.startswith(("{", "["))][-1]
        digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
        assert rules[rule] == f"'sha256-{digest}'"
    addresses = [
        value for _, a in markup.elements for key, value in a.items() if key in ("src", "href", "srcset")
    ]
    assert addresses and all(re.match("data:|#", str(address)) for address in addresses)
