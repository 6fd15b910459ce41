"""Thirty typical mistakes: each costs one line, which holds the remedy, and the exit code is not zero."""

import shutil
from pathlib import Path

import pytest

from blur2view.cli import commands as cli

MISTAKES = [
    # commands
    ("", "name a command: estimate, segment"),
    ("estimat a.png", "did you mean estimate?"),
    ("to_colmap a.png", "did you mean to-colmap?"),
    ("a.png", "did you mean blur2view estimate a.png?"),
    ("--focal 800 estimate a.png", "--focal goes after estimate"),
    # options
    ("estimate a.png --fokal 800", "did you mean --focal?"),
    ("estimate a.png -focal 800", "did you mean --focal?"),
    ("estimate a.png -output out", "did you mean --output?"),
    ("estimate a.png --output-dir out", "did you mean --output?"),
    ("estimate a.png --threads 4", "did you mean --jobs?"),
    ("estimate a.png --db new.db", "an option of blur2view to-colmap"),
    ("segment a.png --focal", "--focal: needs a value behind it"),
    ("estimate", "name photographs, a folder or a video"),
    ("estimate a.png --jobs all", "must be 1 or more"),
    ("estimate a.png --seed one", "expected a number"),
    ("triage a.png --best 3 --every-best 2", "--every-best: does not go with --best; choose one of them"),
    ("segment a.png -o out --masks COLMAP", "expected one of 'colmap'"),
    # units
    ("estimate a.png --focal 26", "26 mm of 35-mm film are 0.72 of the picture's width"),
    ("estimate a.png --focal 26mm", "write pixels, as 26px, or --camera exif"),
    ("estimate a.png --focal 800 --exposure 20", "write 20s or 20ms"),
    ("estimate a.png --exposure 1/50", "with --focal or --camera only; add one"),
    ("estimate a.png --beta 90", "beta must be in (0, 1]"),
    ("estimate a.png --camera 800,600,320,240", "COLMAP's are SIMPLE_PINHOLE, PINHOLE"),
    # files
    ("estimate b.png", "b.png: no such file; check the path"),
    ("estimate empty", "holds no photograph; add --recursive for its subfolders"),
    ("estimate notes.txt", "notes.txt: "),
    ("estimate @missing.txt", "name a file that holds one name on each line"),
    ("estimate a.png -o notes.txt", "choose another folder with -o"),
    ("report a.png -o mine.html", "name another with -o or remove it"),
    ("estimate a.png --camera exif", "give it with --focal"),
    ("estimate a.png --model a.png", "not an ONNX network"),
    # order
    ("to-colmap a.png", "name the database with --db"),
    ("to-colmap a.png --db project.db --link", "project.db: "),
    ("to-colmap a.png --db new.db --replace", "go with --link"),
    ("to-transforms empty", "empty: "),
    ("to-transforms model frames", "frames is too much"),
    ("estimate a.png --resume", "name it with -o"),
]


@pytest.fixture
def folder(tmp_path: Path, still: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the current folder: a photograph, an empty folder and files of the user."""
    shutil.copy(still, tmp_path / "a.png")
    (tmp_path / "empty").mkdir()
    for name in ("notes.txt", "mine.html"):
        (tmp_path / name).write_text("mine")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(("words", "remedy"), MISTAKES, ids=[words for words, _ in MISTAKES])
def test_a_mistake_costs_one_line_with_its_remedy(
    folder: Path, words: str, remedy: str, capsys: pytest.CaptureFixture[str]
) -> None:
    before = sorted(folder.rglob("*"))
    try:
        code = cli.main(words.split())
    except SystemExit as usage:
        code = int(usage.code or 0)
    printed = capsys.readouterr()
    (line,) = printed.err.splitlines()
    assert code in (1, 2) and printed.out == ""
    assert line.startswith("blur2view") and remedy in line
    assert sorted(folder.rglob("*")) == before
    assert (folder / "notes.txt").read_text() == (folder / "mine.html").read_text() == "mine"
