"""A camera that only turned: to-colmap says so, and COLMAP makes no points from it."""

from pathlib import Path

import numpy as np
import pycolmap
import pytest

from blur2view.cli import commands as cli
from blur2view.colmap import database as databases
from blur2view.colmap.mapping import mapper_options, triangulate_exposure
from blur2view.errors import DatabaseError
from tools.datasets.motion_kinds import write_scene

SEEDS = (20_000, 20_001)


@pytest.fixture(scope="module")
def turns(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Return rendered photographs of a camera that only turned; their focal lengths lie beside them."""
    folder = tmp_path_factory.mktemp("turns")
    (folder / "rotation").mkdir()
    for seed in SEEDS:
        write_scene(("rotation", seed), folder, None, (640, 480))
    return sorted(folder.glob("rotation/*.png"))


def points_of(path: Path, out: Path) -> int:
    options = mapper_options()
    options.num_threads = 1
    return sum(one.num_points3D() for one in pycolmap.incremental_mapping(path, ".", out, options).values())


@pytest.mark.slow
def test_a_pure_turn_is_told_and_becomes_no_points(
    turns: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for turn in turns:
        focal, path = str(np.load(turn.with_suffix(".npz"))["K"][0, 0]), tmp_path / f"{turn.stem}.db"
        words = ["to-colmap", "--focal", focal, str(turn), "--db", str(path)]
        assert cli.main(words) == 0
        line, total = capsys.readouterr().out.splitlines()
        assert "translation undecided" in line
        assert total.endswith("the translation of 1 is undecided: COLMAP makes no points from those")
        assert points_of(path, tmp_path) == 0
        with pytest.raises(DatabaseError, match="the translation of .* is undecided"):
            triangulate_exposure(path, turn.name)
        with monkeypatch.context() as without:  # with the inliers it would
            without.setattr(databases, "translation_known", lambda geometry: True)
            assert cli.main(words) == 0
        assert points_of(path, tmp_path) > 50
        capsys.readouterr()
