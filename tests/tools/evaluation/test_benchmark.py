"""The benchmark's parts: what it times runs, and its table says what was measured. Speeds are not tested."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from tools.evaluation import benchmark


@pytest.mark.slow
def test_every_stage_runs_and_leaves_its_files(tmp_path: Path) -> None:
    photo, out = tmp_path / "photo.png", tmp_path / "out"
    texture = np.random.default_rng(0).integers(0, 256, (120, 160, 3), dtype=np.uint8)
    assert cv2.imwrite(str(photo), cv2.GaussianBlur(texture, (0, 0), 2.0))
    out.mkdir()
    times = benchmark.stages(photo, out, repeats=1)
    assert {"decode", "network", "matches", "solve", "draw and write", "decode to F"} < set(times)
    assert {path.name for path in out.glob("*.json")} == {"photo.json", "stages.json"}


def test_the_first_call_is_extra_and_the_table_gives_ratios_memory_and_machine() -> None:
    calls: list[int] = []
    assert benchmark.timed(lambda: calls.append(1), 3) >= 0 and len(calls) == 4
    text = benchmark.page({"decode": 0.5}, (1.0, 345.6), 0.25, repeats=9)
    assert "| decode | 0.500 | 2.00 |" in text and "346 MiB" in text
    assert "cores; medians of 9 runs; one 1280x720 photograph" in text
