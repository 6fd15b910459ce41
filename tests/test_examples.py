"""Examples in the docstrings of public names run, and print what they say."""

import doctest
import inspect
from collections.abc import Iterator
from pathlib import Path

import blur2view


def examples() -> Iterator[doctest.DocTest]:
    """Yield the examples of every public name, and of the methods of public classes."""
    finder = doctest.DocTestFinder(exclude_empty=True)
    for name in blur2view.__all__:
        value = getattr(blur2view, name)
        if inspect.isclass(value) or inspect.isfunction(value):
            yield from (found for found in finder.find(value, name, globs={}) if found.examples)


def test_examples_print_what_they_say(here: Path) -> None:
    (here / "models").symlink_to(Path(blur2view.__file__).resolve().parents[1] / "models")
    said, names = list[str](), set[str]()
    for example in examples():
        doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE).run(example, out=said.append)
        names.add(example.name)
    assert not said, "".join(said)
    assert {"read_image", "timestamps_of", "Camera.from_focal", "Camera.from_opencv"} <= names
