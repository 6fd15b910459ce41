"""The report: one page that loads and runs nothing, and says what the records say."""

import base64
import io
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import blur2view
from blur2view.records.record import Record
from blur2view.results.blur_timeline import Seen, smears_over_time
from blur2view.results.report import SIDE_PX, Section, report, section

FAILED = Record(name="b.jpg", error="b.jpg: is no <picture>")
Entry = tuple[Record, Section | None]


@pytest.fixture
def entry(moving: Path, tiny_model: Path) -> Entry:
    """Return the record of a photograph with F, and its section, with a mask of which the left half moves."""
    image = blur2view.read_image(moving)
    estimate = blur2view.estimate(image, network=tiny_model)
    estimate = replace(estimate, geometry=replace(estimate.geometry, H=None))  # beside which no lines are
    labels = np.zeros(image.shape[:2], np.uint8)
    labels[:, : image.shape[1] // 2] = blur2view.MotionLabel.MOVING
    mask = blur2view.MotionMask(labels=labels, probability=labels.astype(np.float32), regions=(), reason="F")
    one = Record.from_estimate(estimate, name="folder/<b>photo & more.png")
    return one, section(one, estimate, image, mask)


def test_the_page_loads_and_runs_nothing_and_names_are_text(entry: Entry) -> None:
    page = report([entry], "1.2").decode()
    assert "default-src 'none'; img-src data:; style-src 'unsafe-inline'" in page and "<script" not in page
    places = re.findall(r'(?:href|src)="([^"]*)"', page)
    assert places and all(place.startswith(("data:", "#")) for place in places)
    assert "<b>photo" not in page and report([entry], "1.2").decode() == page


def test_it_says_what_the_record_says(entry: Entry) -> None:
    one, page = entry[0], report([entry, entry, (FAILED, None)], "1.2").decode()
    assert page.count(f">{one.verdict}<") == 4  # in the index and above the picture
    assert 'id="photo-0"' in page and 'href="#photo-1"' in page
    assert f"<th>num_inliers</th><td>{one.num_inliers}</td>" in page
    link = re.search(r'download="[^"]+" href="data:application/json;base64,([^"]+)"', page)
    assert link is not None and Record.from_json(base64.b64decode(link[1])) == one
    assert "3 photographs, 1 failed" in page and "b.jpg: is no &lt;picture&gt;" in page


@pytest.mark.parametrize(("count", "rate", "pictures"), [(3, 0.01, 2), (3, None, 1), (2, 0.01, 0)])
def test_of_a_video_it_shows_smears_and_turning_over_time(
    entry: Entry, count: int, rate: float | None, pictures: int
) -> None:
    turning = dict.fromkeys(("wx", "wy", "wz", "sigma_wx", "sigma_wy", "sigma_wz"), rate)
    one = replace(entry[0], **turning)
    shown = [(replace(one, name=f"a.mp4/{k:06d}", frame=k), entry[1]) for k in range(count)]
    page = report([*shown, entry], "1.2").decode()
    assert page.count("<svg") == pictures
    reverse = report([*reversed(shown), entry], "1.2").decode()
    marks = [re.findall(r'<circle cx="([^"]*)"', one) for one in (page, reverse)]
    assert set(marks[0]) == set(marks[1])  # by their numbers, in whichever order they were named
    assert page.count('<a href="#photo-1"><circle') == pictures
    degrees = np.degrees(0.01 * 3**0.5)
    assert (f"a.mp4/000001: {degrees:.3g} +/- " in page) == (pictures == 2)


def test_a_frame_that_was_not_measured_has_no_mark_of_its_smear() -> None:
    frames = [
        Seen(name=f"f_{k}", number=k, kind="sharp", smear_px=smear) for k, smear in enumerate((3.0, None))
    ]
    picture = smears_over_time(frames)
    assert "f_0: sharp 3.0 px" in picture and "f_1" not in picture and "were not measured" in picture
    assert "were not measured" not in smears_over_time(frames[:1])


def test_layers_are_pictures_of_one_size_that_checkboxes_show_and_words_explain(entry: Entry) -> None:
    page = report([entry], "1.2").decode()
    layers = re.findall(r'<img class="(\w+)" src="data:image/webp;base64,([^"]+)"', page)
    assert [name for name, _ in layers] == ["errors", "moves", "lines", "smears"]
    pictures = [np.asarray(Image.open(io.BytesIO(base64.b64decode(content)))) for _, content in layers]
    assert len({one.shape for one in pictures}) == 1
    opacity = {name: one[..., 3] for (name, _), one in zip(layers, pictures, strict=True)}
    assert opacity["moves"][9, 9] > 0 and not opacity["moves"][9, -9] and (opacity["errors"] > 0).all()
    for name in opacity:
        assert f'type="checkbox" class="{name}"' in page and f"input.{name}:not(:checked)" in page
    for words in ("coloured by direction", "White lines", "is pink", "Standard deviations"):
        assert words in page


def test_the_index_has_thumbnails_and_is_ordered_by_name_smear_or_verdict_without_a_script() -> None:
    smears = (3.0, None, 9.0)
    records = [Record(name=f"{k}.jpg", blur="sharp", smear_px=smear) for k, smear in enumerate(smears)]
    part = Section("<h3>the part</h3>", "data:image/webp;base64,AAAA")
    page = report([*((one, part) for one in records[:2]), (FAILED, None), (records[2], part)], "1").decode()
    orders = re.findall(r"<li style=.--name:(\d);--smear:(\d);--verdict:(\d)", page)
    assert [tuple(map(int, order)) for order in orders] == [(0, 1, 0), (1, 2, 1), (3, 3, 3), (2, 0, 2)]
    assert page.count('<img src="data:image/webp;base64,AAAA" alt="">') == 3
    for order in ("smear", "verdict"):
        assert f'type="radio" name="order" class="{order}"' in page
        assert f"body:has(input.{order}:checked) li {{ order: var(--{order}); }}" in page


def test_pictures_of_a_large_photograph_are_of_the_size_that_is_shown(tiny_model: Path) -> None:
    image = np.random.default_rng(0).random((1500, 2000, 3), np.float32)
    estimate = blur2view.estimate(image, network=tiny_model)
    part = section(Record.from_estimate(estimate, name="a.jpg"), estimate, image)
    uris = re.findall(r'src="data:image/webp;base64,([^"]+)"', part.html)
    sizes = {Image.open(io.BytesIO(base64.b64decode(uri))).size for uri in uris}
    assert sizes == {(SIDE_PX, SIDE_PX * 3 // 4)} and len(uris) > 1
