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
    ("--json estimate a.png", "--json goes after estimate"),
    ("estimate a.png --keep=l.txt", "--keep is an option of blur2view triage, not of estimate"),
    ("to-colmap a.png --db new.db --no-mask", "--no-mask is an option of blur2view report, not of to-colmap"),
    ("segment a.png --nonsense", "--nonsense is no option of segment"),
    ("segment a.png --exposure 1", "blur2view to-transforms, blur2view report, blur2view triage, not"),
    ("segment a.png --readout 0.02", "--readout is not for segment: a rolling shutter lengthens"),
    (
        "to-colmap a.png --db new.db --readout=0.02",
        "--readout is not for to-colmap: COLMAP has one pose for all",
    ),
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
    ("estimate a.png --focal 300 --exposure 1/x", "expected seconds as 0.04 or 1/25, got 1/x"),
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
    ("estimate a.png --camera PINHOLE,640,400,500,500,320,200", "is for 640x400 pixels, the photograph has"),
    ("estimate a.png --camera missing.db", "no such database"),
    ("estimate a.png --focal 300 --readout 0.03", "add --exposure S"),
    ("estimate a.png --model a.png", "not an ONNX network"),
    # order
    ("to-colmap a.png", "to-colmap: name --db"),
    ("to-colmap a.png --db project.db --link", "project.db: "),
    ("to-colmap a.png --db new.db --replace", "go with --link"),
    ("to-transforms empty", "empty: "),
    ("to-transforms model frames", "frames is too much"),
    ("estimate a.png --resume", "name it with -o"),
]
WRONG_VALUES = {
    "estimat": ("",),
    "estimate a.png --beta": ("0", "2"),
    "estimate a.png --max-error": ("-1",),
    "estimate a.png --seed": ("-1", "x"),
    "estimate a.png --every": ("0",),
    "estimate a.png --from": ("x",),
    "estimate a.png --to": ("-3",),
    "estimate a.png --jobs": ("0", "2 --dask tcp://a:1"),
    "estimate a.png --max-failures": ("0",),
    "estimate a.png --max-memory": ("nan",),
    "estimate a.png --json": ("--jsonl",),
    "estimate a.png --focal": ("0", "-525", "nan", "1e300", "1e-300", "wide", "525 --camera exif"),
    "estimate a.png --camera": ("nonsense",),
    "estimate a.png --camera PINHOLE 320 240": ("1e300 1e300 160 120", "300 300 1e300 120"),
    "estimate a.png --camera SIMPLE_RADIAL 320 240 300 160 120": ("", "1e300"),
    "estimate a.png --exposure": ("0", "inf"),
    "estimate a.png --readout": ("0.02",),
    "estimate a.png --focal 300 --exposure": ("1e-320", "1/0", "/20", "1/2/3"),
    "estimate a.png --focal 300 --readout": ("-0.01", "nan", "25"),
    "triage a.png --resume": ("",),
    "triage a.png --csv t.csv": ("--max-smear -1", "--every-best 2"),
    "triage a.png --keep k": ("--max-smear nan%", "--best 0", "--best 1.5", "--best 101%"),
    "segment a.png --masks colmap": ("",),
    "to-colmap a.png --db new.db": ("--replace", "--no-backup", "--focal -1", "--seed -1", "-o x"),
    "to-colmap a.png --db new.db --dask tcp://127.0.0.1:9": ("--link", "--camera project.db:1"),
    "place project.db model frames -o out --fraction": ("0",),
}


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


@pytest.mark.parametrize(
    "words", [f"{words} {value}" for words, values in WRONG_VALUES.items() for value in values]
)
def test_value_that_an_option_does_not_take_is_exit_code_2(
    words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    before, camera, values = words.partition("--camera ")
    with pytest.raises(SystemExit) as caught:
        cli.main([*before.split(), *([camera.strip(), values.strip()] if camera else [])])
    assert caught.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("blur2view") and words.split()[0] in line
