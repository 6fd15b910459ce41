"""The mover network: pictures of things whose truth is what was drawn, its training, and its file."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
import pytest
import torch

from blur2view.errors import ModelError
from blur2view.movers.network import MoverNetwork
from tests.support.colour_code import colour_code_network
from tools.rendering import things
from tools.rendering.things import KINDS, ThingOptions, photographed_things
from tools.training.export_movers import main
from tools.training.movers import CELLS, PLACES, Movers
from tools.training.train_movers import batch_of, loss_of

SMALL = ThingOptions(size=(96, 64), smear_px=(4.0, 8.0), area=(0.1, 0.3), blob_share=1.0, focus_share=0.0)


def of_kind(name: str, seed: int) -> things.Things:
    photo = np.random.default_rng(0).integers(0, 255, (200, 300, 3), dtype=np.uint8)
    shares = tuple(float(kind.__name__ == name) for kind in KINDS)
    return photographed_things(np.random.default_rng(seed), [photo], replace(SMALL, kinds=shares))


@pytest.mark.parametrize("seed", range(3))
def test_what_moves_by_itself_is_what_is_told(seed: int) -> None:
    for name in ("deep", "unmoved", "flat"):
        assert not of_kind(name, seed).moving.any()
    moving = [of_kind(name, seed) for name in ("following", "crossing", "standing")]
    assert all(picture.moving.max() > 0.5 and picture.linear.shape == (64, 96, 3) for picture in moving)
    stands = moving[2]
    assert np.linalg.norm(stands.displacement[stands.moving < 0.01], axis=-1).max() < 1
    assert np.median(np.linalg.norm(stands.displacement[stands.moving > 0.9], axis=-1)) > 2


def shard(count: int = 4) -> dict[str, np.ndarray]:
    """Make pictures in which what is bright moves."""
    rng = np.random.default_rng(1)
    moving = np.kron(rng.integers(0, 2, (count, 4, 4)), np.ones((8, 8)))
    places = rng.normal(0, 0.1, (count, 32, 32, PLACES)) + moving[..., None]
    cells = rng.normal(0, 1, (count, 4, 4, CELLS))
    return {"moving": moving, "places": places, "cells": cells, "read": moving > 0}


@pytest.mark.slow
def test_training_learns_what_moves_and_leaves_out_what_is_unknown() -> None:
    torch.manual_seed(0)
    network, rng, shards = Movers(), np.random.default_rng(0), [shard()]
    optimiser = torch.optim.AdamW(network.parameters(), 3e-3)
    losses = []
    for _ in range(12):
        places, cells, moving, read = batch_of(shards, rng)
        losses.append(loss_of(network(places, cells), moving, read))
        optimiser.zero_grad()
        losses[-1].backward()
        optimiser.step()
    assert losses[-1] < 0.6 * losses[0]
    odds, unknown = torch.full((1, 2, 8, 8), 20.0), torch.full((1, 8, 8), -1.0)
    unknown[0, 0, 0] = 1.0
    assert loss_of(odds, unknown, torch.ones(1, 8, 8)) < 1e-6


@pytest.mark.slow
def test_file_computes_what_torch_does_and_another_is_refused(tmp_path: Path) -> None:
    torch.manual_seed(0)
    network = Movers().eval()
    state = {"average": network.state_dict(), "step": 3, "batch": 8, "seed": 0}
    torch.save(state, tmp_path / "last.pt")
    main([tmp_path / "last.pt"] * 2, tmp_path / "movers.onnx")
    places, cells = np.zeros((40, 24, PLACES), np.float32), np.zeros((5, 3, CELLS), np.float32)
    moving, read = MoverNetwork(tmp_path / "movers.onnx").log_odds(places, cells)
    assert moving.shape == read.shape == (40, 24)
    onnx.save(colour_code_network(), tmp_path / "other.onnx")
    with pytest.raises(ModelError, match="is not a mover network"):
        MoverNetwork(tmp_path / "other.onnx")
    with pytest.raises(ModelError, match="cannot be run"):
        MoverNetwork(tmp_path / "movers.onnx").log_odds(places[:, :8], cells)
