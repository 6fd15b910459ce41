"""Training of the reader: a stopped run ends the same."""

import json
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from tests.tools.rendering.test_layer_scenes import noise_and_disc
from tools.datasets.shards import write_shards
from tools.training import reader_data, run
from tools.training.export import load_average
from tools.training.reader_data import examples
from tools.training.train_reader import main

pytestmark = pytest.mark.slow  # the maps of the spectra take seconds


def test_resumed_run_ends_with_the_weights_of_one_without_a_stop(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    shards, sources = tmp_path / "examples", noise_and_disc(np.random.default_rng(0))
    monkeypatch.setattr(reader_data, "SHARD_PX", 320 * 256)
    write_shards(shards, (10, 14), partial(examples, sources=sources))
    words: dict[str, Any] = {"train": shards, "val": shards, "steps": 2, "batch": 2, "every": 1}
    out = tmp_path / "whole", tmp_path / "parted"
    main(out=out[0], **words)
    line = json.loads(capfd.readouterr().out.splitlines()[-1])
    assert line["step"] == 2 and line == json.loads((out[0] / "log.jsonl").read_text().splitlines()[-1])
    figures = [line["loss"], *line["0"].values(), *line["1"].values()]
    assert len(figures) == 13 and np.isfinite(figures).all()

    save = run.save

    def stopped(*words: Any) -> None:
        save(*words)
        raise KeyboardInterrupt

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(run, "save", stopped)
        main(out=out[1], **words)
    main(out=out[1], **words)
    first, resumed = (load_average(one / "last.pt") for one in out)
    assert first["step"] == resumed["step"] == 2 and first["figures"] == resumed["figures"]
    for name, one in first["average"].items():
        assert torch.equal(one, resumed["average"][name])
