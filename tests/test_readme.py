"""README: every command and every block of Python runs, and every link leads somewhere."""

import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from inspect import cleandoc
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import pytest

from blur2view import __version__
from blur2view.cli.commands import COMMANDS
from blur2view.colmap import mapping
from tests.support.calls import call_program
from tests.support.many_photographs import ROOT, SAMPLE, write_frames
from tests.support.walks import Walk

README = (ROOT / "README.md").read_text()
NOT_RUN = ("pip install ", "python -m pytest ", "pre-commit install", "dask ")
"""How the commands begin that install, test or start a cluster, which no test does."""
TEST_COMMAND = "pip install '.[train,test]' && python -m pytest -n auto --dist worksteal"


class Section(NamedTuple):
    """A part of README under one title, with its blocks of code: language and text."""

    title: str
    text: str
    blocks: list[tuple[str, str]]


def sections() -> Iterator[Section]:
    """Yield the parts of README that hold code."""
    for part in re.split(r"^##+ ", README, flags=re.MULTILINE)[1:]:
        title, _, text = part.partition("\n")
        blocks = re.findall(r"^```(\w+)\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
        if blocks:
            yield Section(title, text, blocks)


def commands(block: str) -> list[str]:
    """Return the commands of a shell block that are run here; every other one must be listed as not run."""
    every = [part.strip() for line in block.splitlines() for part in line.split("&&")]
    elsewhere = "--dask ", " reconstruct "  # see test_dask.py and test_reconstruct.py
    every = [command for command in every if not any(words in command for words in elsewhere)]
    run = [command for command in every if command.startswith("blur2view ")]
    unknown = [one for one in every if one not in run and not one.startswith(NOT_RUN)]
    assert not unknown, f"neither run nor listed in NOT_RUN: {unknown}"
    return run


def named_files(text: str) -> list[str]:
    """Return the files inside folders that a text names in backticks."""
    return re.findall(r"`([\w.]+(?:/[\w.]+)+\.\w+)`", text)


CODE = list(sections())
RUNNABLE = [
    section
    for section in CODE
    if any(language == "python" or language == "sh" and commands(body) for language, body in section.blocks)
]


PHOTOGRAPHS = ("a.jpg", "b.jpg", "photographs/one.jpg", "photographs/two.jpg")
FRAMES = ("f_000.jpg", "f_010.jpg", "f_020.jpg")  # every tenth of a video


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder with the files that README names: the desk, and all but the samples, at half size."""
    (tmp_path / "models").mkdir()
    for path in (ROOT / "models").glob("*.jpg"):
        shutil.copy(path, tmp_path / "models")
    desk = np.asarray(cv2.imread(str(ROOT / "models/desk.jpg")))  # of nine times the sample's pixels
    cv2.imwrite(str(tmp_path / "models/desk.jpg"), cv2.resize(desk, None, fx=0.5, fy=0.5))
    picture = cv2.resize(np.asarray(cv2.imread(str(SAMPLE))), None, fx=0.5, fy=0.5)
    for name in (*PHOTOGRAPHS, *(f"frames/{frame}" for frame in FRAMES)):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        cv2.imwrite(str(tmp_path / name), picture)
    write_frames(tmp_path / "video.mp4", [picture] * 7)
    turn, move = np.array([0.002, 0.006, -0.001]), np.array([0.9, 0.1, 0.05])  # of the camera, a frame
    size = picture.shape[1], picture.shape[0]
    points = np.random.default_rng(0).uniform(-1, 1, (200, 3)) * (1.5, 1, 2) + (0, 0, 7)
    walk = Walk(names=FRAMES, size=size, focal=400.0, turn=turn, move=move)
    walk.write(points, tmp_path / "project.db", {tmp_path / "model" / "0": range(len(FRAMES))})
    return tmp_path


@pytest.fixture
def call(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[[str, str], str]:
    """Return a function that runs a text in the folder, a command in this process, and gives its output."""
    monkeypatch.chdir(folder)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0}, raising=False)  # no processes to start

    def run(language: str, text: str) -> str:
        if language == "sh":
            done = call_program(capsys, *shlex.split(text, comments=True)[1:])
            assert done == 0, f"{text}\n{done.out}\n{done.err}"
            return done.out
        program = [sys.executable, "-W", "error", "-c", text]
        environment = os.environ | {"PYTHONPATH": str(ROOT)}
        ended = subprocess.run(program, env=environment, capture_output=True, text=True)
        assert ended.returncode == 0, f"{text}\n{ended.stdout}\n{ended.stderr}"
        return ended.stdout

    return run


@pytest.mark.slow
@pytest.mark.parametrize("section", RUNNABLE, ids=lambda section: section.title)
def test_every_command_and_python_block_runs(
    section: Section, folder: Path, call: Callable[[str, str], str]
) -> None:
    printed = ""
    for language, body in section.blocks:
        if language == "text":  # what the command before it prints
            given, made = (re.sub(r"\d+(\.\d+)?", "0", one.strip()) for one in (body, printed))
            assert given == made  # but for figures, which follow the network
            continue
        for text in commands(body) if language == "sh" else [body]:
            printed = call(language, text)
            assert not re.search(r"\bnan\b", printed)
    missing = [name for name in named_files(section.text) if not (folder / name).is_file()]
    assert not missing, f"named, but not written: {missing}"


@pytest.mark.slow
def test_every_way_to_map_runs(folder: Path, call: Callable[[str, str], str]) -> None:
    for name in ("a.jpg", "b.jpg"):
        shutil.copy(SAMPLE, folder / name)
    call("sh", "blur2view to-colmap --db new.db --focal 800 a.jpg b.jpg")
    call("sh", "blur2view to-colmap --db project.db --link --sequence frames")
    blocks = re.findall(r"::\n\n((?:    .*\n|\n)+)", mapping.__doc__ or "")
    assert len(blocks) == 2
    for block in blocks:
        call("python", cleandoc(block))
    models = {str(path.parent.relative_to(folder)) for path in folder.rglob("cameras.bin")}
    assert models >= {"exposures/0", "exposures/1", "joined", "anew/0", "global/0"}


def test_every_option_that_is_named_exists(capsys: pytest.CaptureFixture[str]) -> None:
    named = set(re.findall(r"--[a-z][a-z-]*", README.partition("- Gone:")[0]))
    helps = [call_program(capsys, command, "--help-all").out for command in COMMANDS]
    of_others = {"--image", "--kinds", "--scenes", "--dist"}  # COLMAP's list, tools', pytest's
    assert named - of_others <= set(re.findall(r"--[a-z][a-z-]*", "".join(helps)))


def test_every_kind_of_block_is_run_or_known() -> None:
    languages = {language for section in CODE for language, _ in section.blocks}
    assert languages == {"sh", "python", "text"}
    assert README.count("```") == 2 * sum(len(section.blocks) for section in CODE)
    assert len(RUNNABLE) >= 9


def test_every_link_and_picture_exists() -> None:
    targets = re.findall(r"\]\(([^)\s]+)\)", README)
    local = [target.partition("#")[0] for target in targets if not target.startswith("https://")]
    assert local and not [target for target in local if not (ROOT / target).exists()]
    rest = README
    for section in RUNNABLE:
        rest = rest.replace(section.text, "")
    assert not [name for name in named_files(rest) if not (ROOT / name).is_file()]


def test_continuous_integration_runs_the_test_command_of_readme() -> None:
    assert TEST_COMMAND in README.splitlines()
    script = ROOT / ".ci/run"
    if script.exists():  # no part of a source distribution
        assert TEST_COMMAND in script.read_text().splitlines()


def test_changelog_has_the_version() -> None:
    assert re.search(rf"^### {re.escape(__version__)}$", README, re.MULTILINE)
