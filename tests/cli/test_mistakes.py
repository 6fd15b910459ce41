"""One mistake of each kind: it costs one line, with the remedy, and the exit code is not zero."""

import os
import shlex
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from blur2view.cli import commands as cli

MISTAKES = [
    ("help estimate", "write blur2view estimate --help"),
    ("estimate a.png -o out.json", "-o names a folder; one file holds what --json > out.json"),
    ("estimate a.png --json out.json", "--json and --jsonl print; write > out.json at the end"),
    ("report a.png -o report.pdf", "a report is HTML; name it report.html"),
    ("estimate A.PNG", "A.PNG: no such file; did you mean a.png?"),
    ("estimate notes.text", "did you mean notes.txt?"),
    ("estimate a.png,a.png", "name each by itself: a.png a.png"),
    ("estimate 'a.png notes.txt'", "name each by itself: a.png notes.txt"),
    ("estimate a.png --verbose=2", "-v/--verbose: takes no value, got '2'"),
    ("estimate a.png --recursive=film", "--recursive: takes no value, got 'film'"),
    (
        "estimate --input a.png",
        "--input is no option of estimate; did you mean the names of photographs alone?",
    ),
    ("estimate a.png --gpu", "did you mean --provider cuda?"),
    ("estimate a.png --threads 4", "did you mean --jobs?"),
    ("estimate a.png --focal_length 800", "did you mean --focal?"),
    ("estimate a.png --intrinsics K.txt", "did you mean --camera?"),
    ("estimate a.png --exif", "did you mean --camera exif?"),
    ("estimate a.png --list notes.txt", "did you mean @LIST, a file of names?"),
    ("triage a.png --fps 2", "did you mean --every?"),
    ("estimate a.png --camera notes.txt", "or write its line out: MODEL WIDTH HEIGHT"),
    ("estimate a.png --provider gpu", "cuda comes with onnxruntime-gpu"),
    ("estimate a.png --timestamps no.csv", "no.csv: cannot be read"),
    ("segment a.png -o out --masks colmap nerfstudio", "for nerfstudio, too, add --masks nerfstudio"),
    ("", "name a command: estimate, segment"),
    ("estimat a.png", "did you mean estimate?"),
    ("a.png", "did you mean blur2view estimate a.png?"),
    ("--focal 800 estimate a.png", "--focal goes after estimate"),
    ("estimate a.png --fokal 800", "--fokal is no option of estimate; did you mean --focal?"),
    ("estimate a.png --keep=l.txt", "--keep is an option of blur2view triage, not of estimate"),
    ("segment a.png --exposure 1", "blur2view to-transforms, blur2view report, blur2view triage, not"),
    (
        "to-colmap a.png --db new.db --readout=0.02",
        "--readout is not for to-colmap: COLMAP has one pose for all",
    ),
    ("segment a.png --focal", "--focal: needs a value behind it"),
    ("estimate", "name photographs, a folder or a video"),
    ("place project.db model frames", "name -o/--output"),
    ("to-transforms model frames", "frames is too much"),
    ("triage a.png --best 3 --every-best 2", "--every-best: does not go with --best; choose one of them"),
    ("segment a.png -o out --masks COLMAP", "expected one of 'colmap'"),
    ("segment a.png --masks colmap", "--masks needs a folder; name it with -o"),
    ("estimate a.png --seed one", "--seed: expected a number, got 'one'"),
    ("estimate a.png --focal 26", "26 mm of 35-mm film are 0.72 of the picture's width"),
    ("estimate a.png --focal 800 --exposure 20", "write 20s, 20ms or 1/20"),
    ("estimate a.png --exposure 1/50", "which need --focal or --camera; add one"),
    ("estimate a.png --camera 800,600,320,240", "COLMAP's are SIMPLE_PINHOLE, PINHOLE"),
    ("estimate b.png", "b.png: no such file; check the path"),
    ("estimate empty", "holds no photograph; add --recursive for its subfolders"),
    ("estimate @missing.txt", "name a file that holds one name on each line"),
    ("estimate a.png -o notes.txt", "(File exists); name another folder"),
    ("report a.png -o mine.html", "name another with -o or remove it"),
    ("estimate a.png --camera exif", "give it with --focal"),
    ("estimate a.png --camera PINHOLE,640,400,500,500,320,200", "is for 640x400 pixels, the photograph has"),
    ("estimate a.png --focal 300 --readout 0.03", "add --exposure S"),
    ("estimate a.png --model a.png", "not an ONNX network"),
    ("to-colmap a.png", "name --db"),
    ("to-colmap a.png --db project.db --link", "project.db: "),
    ("to-transforms empty", "empty: "),
    ("estimate a.png --resume", "name it with -o"),
    ("estimate https://a.org/b.jpg", "https://a.org/b.jpg: is no file here; download it first"),
    ("estimate film", "film: holds no photograph; name its video, film/clip.mp4"),
    ("estimate a.png --every 0.5s", "counts frames; 0.5s are 15 in a video of 30 a second"),
    ("place a.db model film -o out --fraction 1e308", "must be above 0 and at most 1, got 1e308"),
    ("estimate project.db", "a COLMAP database goes to --camera, to-colmap --db or place"),
    ("estimate linked", "it is a link to .git/annex/a.jpg, fetch that (git annex get, dvc checkout)"),
    ("estimate @utf16.txt", "it is UTF-16; save it as UTF-8"),
    ("estimate @a.png", "it is no text; a photograph itself is named by its file"),
    ("estimate @", "@: name a list behind @, as @list.txt"),
    ("estimate a.png -out o", "-out has one dash; did you mean --output?"),
    ("estimate '~/a.jpg'", "~/a.jpg: no such file; write ~ without quotes"),
    ("estimate '*.jpg'", "*.jpg: no such file; no name fits this pattern, or it stands in quotes"),
    ("triage a.png --extract .", ".: holds the photographs themselves; name an empty folder"),
    ("estimate ''", "an input is empty; is it a variable that is not set?"),
    ("estimate a.png -o ''", "-o is empty"),
    ("estimate a.jpg --foca 800", "--foca is no option of estimate; did you mean --focal?"),
    ("report a.png --resume", "--resume is not for report: a page is drawn anew"),
    ("to-colmap a.png --db .", "exists"),
    ("estimate names.txt", "if it lists photographs, write @names.txt"),
    ("estimate loop.jpg -o out", "loop.jpg: "),
    ("estimate a\0.png", "a\\x00.png: "),
    ("estimate a.png --model a\0", "a\\x00: "),
    ("report a.png -o a\0", "a path has no null character"),
    ("estimate a.png --camera 'PINH\0OLE 4 4 4'", "unknown model PINH\\x00OLE"),
    ("estimate a.png --max-memory 1e-5", "--max-memory 1"),
    ("estimate a.png -o notes.txt/below", "results cannot be written there"),
    ("estimate a.png -o o2 --csv o2/a.json", "two results would be one file"),
    ("segment a.png -o o2 --csv o2/a.motion.json", "two results would be one file"),
    ("estimate a.png --csv o2/.estimate.manifest.jsonl -o o2", "two results would be one file"),
    ("triage a.png empty --csv .k.txt.manifest.jsonl --keep k.txt", "two results would be one file"),
    ("to-colmap a.png --db a.db --csv a.db-wal", "two results would be one file"),
    ("triage a.png --keep-for-poses a.txt --keep-for-training a.txt", "two results would be one file"),
    ("triage a.png --keep-for-poses mine.html", "name another with --keep-for-poses"),
    ("triage a.png --gsd 2", "expected a distance with its unit as 2cm"),
    ("triage a.png --max-smear 2cm", "needs --gsd"),
    ("triage a.png --csv a.png --overwrite", "would replace a photograph"),
    ("triage a.png --keep a.png --overwrite", "would replace a photograph"),
    ("triage @names.txt --csv names.txt", "names.txt: "),
    ("triage @names.txt --keep names.txt --overwrite", "names.txt: names the photographs of this call"),
    ("triage a.png --keep endless", "is no list of an earlier call"),
    ("report a.png -o a.png --overwrite", "the page would replace a photograph; name another with -o"),
    ("report a.png -o empty", "empty: is a folder; name the page with -o"),
    ("report a.png -o pipe --overwrite", "is no page of an earlier call"),
    ("estimate a.png -o new --csv notes.txt --overwrite", "is no table of an earlier call"),
    ("triage a.png --csv new/t.csv --keep notes.txt --overwrite", "is no list of an earlier call"),
    (f"estimate {'n' * 5000}.png", "cannot be read (File name too long)"),
]
WRONG_VALUES = [
    "estimate a.png --beta 0",
    "estimate a.png --jobs 2 --dask tcp://a:1",
    "estimate a.png --max-memory nan",
    "estimate a.png --json --jsonl",
    "estimate a.png --focal 1e300",
    "estimate a.png --focal 525 --camera exif",
    "estimate a.png --camera PINHOLE,320,240,300,300,1e300,120",
    "estimate a.png --focal 300 --exposure 1/0",
    "estimate a.png --focal 300 --exposure 1e-320",
    "estimate a.png --focal 300 --readout 25",
    "triage a.png --resume",
    "triage a.png --keep k --max-smear nan%",
    "triage a.png --keep k --best 1.5",
    "triage a.png --csv t.csv --every-best 2",
    "to-colmap a.png --db new.db --replace",
    "to-colmap a.png --db new.db --dask tcp://127.0.0.1:9 --link",
    "to-colmap a.png --db new.db -o x",
]
MISTAKES += [(words, f"blur2view {words.split()[0]}: ") for words in WRONG_VALUES]  # of wrong usage alone


@pytest.fixture
def folder(tmp_path: Path, still: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the current folder: a photograph, an empty folder and files of the user."""
    shutil.copy(still, tmp_path / "a.png")
    for name in ("empty", "film", "linked"):
        (tmp_path / name).mkdir()
    (tmp_path / "film/clip.mp4").touch()
    (tmp_path / "linked/a.jpg").symlink_to(".git/annex/a.jpg")
    (tmp_path / "loop.jpg").symlink_to("loop.jpg")
    (tmp_path / "endless").symlink_to("/dev/zero")
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "names.txt").write_text("a.png\na.png\n")
    (tmp_path / "utf16.txt").write_text("a.png\n", encoding="utf-16")
    with closing(sqlite3.connect(tmp_path / "project.db")) as database:
        database.execute("CREATE TABLE images (name TEXT)")
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
