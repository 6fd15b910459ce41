"""One mistake of each kind: it costs one line, with the remedy, and the exit code is not zero."""

import shlex
import shutil
from pathlib import Path

import pytest

from blur2view.cli import commands as cli

MISTAKES = [
    ("estimat a.png", "estimat is not a command; did you mean estimate?"),
    ("estimate a.png --fokal 800", "--fokal is not an option of estimate; did you mean --focal?"),
    ("estimate", "name photographs, a folder or a video"),
    ("place project.db model frames", "name -o/--output"),
    ("recover", "name MODEL, FRAMES, -o/--output"),
    ("to-transforms model frames", "unexpected argument: frames"),
    ("segment a.png -o out --masks COLMAP", "expected colmap, nerfstudio or instant-ngp, got COLMAP"),
    ("segment a.png --masks colmap", "--masks needs a folder of results; name it with -o"),
    ("estimate a.png --seed one", "--seed: must be a whole number, 0 or more, got one"),
    ("estimate a.png --focal 26", "80px for fewer than 100"),
    ("estimate a.png --focal 300 --gyroflow new.gcsv", "a log of rates holds one video"),
    ("estimate a.png --exposure 1/50", "add --focal PX or --camera"),
    ("estimate empty", "holds no photograph or video; name another folder"),
    ("estimate @missing.txt", "name a file that holds one name on each line"),
    ("estimate a.png -o notes.txt", "notes.txt: is not a folder"),
    ("report a.png -o mine.html", "mine.html: already exists and was not written by blur2view"),
    ("estimate a.png --focal 300 --readout 0.03", "add --exposure S"),
    ("to-colmap a.png", "name --db"),
    ("to-colmap a.png --db project.db --link", "project.db: "),
    ("estimate a.png --resume", "name it with -o"),
    ("estimate ''", "an argument is empty; is it a variable that is not set?"),
    ("estimate a.png -o o2 --csv o2/a.json", "two results would be one file"),
    ("triage @names.txt --keep names.txt", "would replace an input"),
    ("triage a.png --keep endless", "endless: is not a regular file"),
    ("estimate a.png -o new --csv notes.txt", "notes.txt: already exists and was not written by blur2view"),
    ("estimate a.png --csv empty", "empty: is a folder; name a file with --csv"),
    ("report a.png -o new/", "--output: expected a file, got the folder new/"),
    (f"estimate a.png -o {'o' * 300}", "(File name too long); name another folder"),
    (f"triage a.png --keep {'k' * 300}", "(File name too long); name another with --keep"),
    ("triage a.png --extract new --keep new/k.txt", "--keep must lie outside"),
    ("triage clip.mp4 --from 9s --to 2s", "--from 9s comes after --to 2s; swap them"),
    ("triage absent.mp4 --every-best 1s --extract new", "absent.mp4: no such file"),
    ("estimate absent.mp4 --every 2", "absent.mp4: no such file"),
    ("triage clip.mp4 --from -5", "expected a frame counted from 0, as 120"),
    ("triage a.png --csv /dev/full", "/dev/full: is not a regular file"),
    ("estimate a.png --dask tls://127.0.0.1:9", "expected tcp://HOST:PORT"),
]
WRONG_VALUES = [
    "estimate a.png --focal 300 --exposure 1/0",
    "estimate a.png --focal 300 --readout 25",
    "to-colmap a.png --db new.db --dask tcp://127.0.0.1:9 --link",
]
MISTAKES += [(words, f"blur2view {words.split()[0]}: ") for words in WRONG_VALUES]  # of wrong usage alone


@pytest.fixture
def folder(tmp_path: Path, still: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the current folder: a photograph, an empty folder and files of the user."""
    shutil.copy(still, tmp_path / "a.png")
    (tmp_path / "empty").mkdir()
    (tmp_path / "endless").symlink_to("/dev/zero")
    (tmp_path / "names.txt").write_text("a.png\na.png\n")
    (tmp_path / "project.db").write_bytes(b"no database")
    for name in ("notes.txt", "mine.html"):
        (tmp_path / name).write_text("mine")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(("words", "remedy"), MISTAKES, ids=[words for words, _ in MISTAKES])
def test_a_mistake_costs_one_line_with_its_remedy(
    folder: Path, words: str, remedy: str, capsys: pytest.CaptureFixture[str]
) -> None:
    before, picture = sorted(folder.rglob("*")), (folder / "a.png").read_bytes()
    try:
        code = cli.main(shlex.split(words))
    except SystemExit as usage:
        code = int(usage.code or 0)
    printed = capsys.readouterr()
    (line,) = printed.err.splitlines()
    assert code in (1, 2) and printed.out == ""
    assert line.startswith("blur2view") and remedy in line
    assert sorted(folder.rglob("*")) == before
    assert (folder / "notes.txt").read_text() == (folder / "mine.html").read_text() == "mine"
    assert (folder / "a.png").read_bytes() == picture
