"""Training of the reader: examples made twice are equal, a stopped run ends the same."""

import json
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from tools.datasets.shards import write_shards
from tools.rendering.shaken import ShakeOptions
from tools.training import reader_data, run
from tools.training.reader import Reader
from tools.training.reader_data import examples
from tools.training.train_reader import load_average, main

MOVING = partial(ShakeOptions, still_share=0.0, rest_share=0.0, focus_still_share=0.0)

pytestmark = pytest.mark.slow  # the maps of the spectra take seconds


@pytest.fixture(scope="module")
def shards(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder of two shards of two examples of one photograph, of noise of two sizes."""
    rng = np.random.default_rng(0)
    coarse = rng.integers(0, 200, (60, 80, 3)).repeat(8, 0).repeat(8, 1)
    photo = (coarse + rng.integers(0, 56, coarse.shape)).astype(np.uint8)
    folder = tmp_path_factory.mktemp("examples")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reader_data, "SHARD_PX", 2 * 640 * 512)
        patch.setattr(reader_data, "ShakeOptions", MOVING)
        write_shards(folder, range(2), partial(examples, photos=[photo], rendered_share=0.0))
    return folder


def test_resumed_run_ends_with_the_weights_of_one_without_a_stop(
    shards: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    words: dict[str, Any] = {
        "train": shards,
        "val": shards,
        "steps": 2,
        "shards": 2,
        "batch": 2,
        "save_every": 1,
    }
    out = tmp_path / "whole", tmp_path / "parted"
    main(out=out[0], **words)
    line = json.loads(capfd.readouterr().out.splitlines()[-1])
    assert line["step"] == 2 and line == json.loads((out[0] / "log.jsonl").read_text())
    figures = [line["loss"], *line["000000"].values(), *line["000001"].values()]
    assert len(figures) == 15 and np.isfinite(figures).all()

    save = run.save

    def stopped(*words: Any) -> None:
        save(*words)
        raise KeyboardInterrupt

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(run, "save", stopped)
        main(out=out[1], **words)
    main(out=out[1], **words)
    (first, state), (second, resumed) = (load_average(one / "last.pt") for one in out)
    assert state["step"] == resumed["step"] == 2 and state["figures"] == resumed["figures"]
    for one, other in zip(first.state_dict().values(), second.state_dict().values(), strict=True):
        assert torch.equal(one, other)
    start = Reader().state_dict()
    assert any(not torch.equal(value, start[name]) for name, value in first.state_dict().items())
