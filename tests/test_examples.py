"""Every public function says what it takes and returns; examples run, and print what they say."""

import doctest
import inspect
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

import blur2view
from tests.support.blurred_plane import BlurredPlane

FUNCTIONS = {name: getattr(blur2view, name) for name in blur2view.__all__}
FUNCTIONS = {name: value for name, value in FUNCTIONS.items() if inspect.isfunction(value)}
SECTIONS = ["Parameters", "Returns", "Raises", "References", "Examples"]  # in numpydoc's order
NOT_RUN = {"estimate_frames", "place_views", "reconstruct"}  # theirs are text: of a recording, of minutes


def examples() -> Iterator[doctest.DocTest]:
    """Yield the examples of every public name, and of the methods of public classes."""
    finder = doctest.DocTestFinder(exclude_empty=True)
    for name in blur2view.__all__:
        value = getattr(blur2view, name)
        if inspect.isclass(value) or inspect.isfunction(value):
            yield from (found for found in finder.find(value, name, globs={}) if found.examples)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_public_functions_have_the_sections_of_numpydoc_and_a_type_of_each_parameter(name: str) -> None:
    lines = inspect.getdoc(FUNCTIONS[name]) or ""
    takes = [*inspect.signature(FUNCTIONS[name]).parameters]
    title, *parts = re.split(r"\n\n(\w+)\n-+\n", lines)
    sections = dict(zip(parts[::2], parts[1::2], strict=True))
    assert title and {*["Parameters"] * bool(takes), "Returns", "Examples"} <= sections.keys() <= {*SECTIONS}
    assert [*sections] == sorted(sections, key=SECTIONS.index)
    described = re.findall(r"^(\w.*) : .+$", sections.get("Parameters", ""), re.MULTILINE)
    assert ", ".join(described).split(", ") == (takes or [""])


def test_examples_print_what_they_say(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (here / "models").symlink_to(Path(blur2view.__file__).resolve().parents[1] / "models")
    BlurredPlane(frames=5).write(here, [0, 1, 2, 4])
    every, once = [*examples()], cache(blur2view.estimate)  # the sample is estimated once for all
    monkeypatch.setattr(blur2view, "estimate", lambda photograph, **options: once(photograph))
    said, names = list[str](), set[str]()
    for example in every:
        doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE).run(example, out=said.append)
        names.add(example.name)
    assert not said, "".join(said)
    assert {*FUNCTIONS} - names == NOT_RUN and {"Camera.from_focal", "Camera.from_opencv"} <= names
