"""The network of blur against the camera's motion: drawn, trained, exported, it is one the package takes."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch

from blur2view.networks.mover_networks import BLUR, MoverNetwork
from tests.tools.training.test_unet import noise_and_disc
from tools.datasets.shards import load_shard, write_shards
from tools.training.export_movers import main
from tools.training.movers import CELLS, PLACES, Movers
from tools.training.run import Schedule, fit
from tools.training.train_movers import MoverTask, batch_of, examples, loss_of


@pytest.mark.slow
def test_a_network_of_drawn_scenes_is_one_that_the_package_takes(tmp_path: Path) -> None:
    torch.manual_seed(0)
    sources = noise_and_disc(np.random.default_rng(0))
    tiny = partial(examples, seed=0, sources=sources, size=(128, 96), count=3)
    write_shards(tmp_path / "examples", range(2), tiny)
    schedule = Schedule(
        out=tmp_path, steps=2, rate=1e-3, largest_gradient=2.0, seed=0, save_every=2, validate_every=2
    )
    figures = fit(MoverTask(tmp_path / "examples", tmp_path / "examples", 0), schedule)
    assert figures and all(0 <= value <= 1 for value in figures.values())
    main([tmp_path / "last.pt"] * 2, tmp_path / "movers.onnx")
    one = load_shard(tmp_path / "examples/000000.npz")
    places, cells = (one[name][0].astype(np.float32) for name in BLUR.inputs)
    network = Movers().eval()
    network.load_state_dict(torch.load(tmp_path / "last.pt", weights_only=True)["average"])
    with torch.no_grad():
        expected = network(torch.from_numpy(places)[None], torch.from_numpy(cells)[None])[0]
    found = MoverNetwork(BLUR, tmp_path / "movers.onnx")(
        np.moveaxis(places, 0, -1), np.moveaxis(cells, 0, -1)
    )
    assert expected.shape == (2, 24, 32)
    np.testing.assert_allclose(found[0], expected, atol=2e-3)


@pytest.mark.slow
def test_training_learns_what_moves() -> None:
    torch.manual_seed(0)
    rng = np.random.default_rng(1)
    moving = np.kron(rng.integers(0, 2, (8, 4, 4)), np.ones((8, 8)))
    places = rng.normal(0, 0.1, (8, PLACES, 32, 32)) + moving[:, None]
    cells = rng.normal(0, 1, (8, CELLS, 4, 4))
    shard = {"moving": moving, "places": places, "cells": cells, "read": moving > 0, "kind": np.zeros(8)}
    network, losses = Movers(), list[float]()
    optimiser = torch.optim.AdamW(network.parameters(), 3e-3)
    for _ in range(12):
        batch = batch_of(shard, rng)
        loss = loss_of(network(batch["places"], batch["cells"]), batch)
        optimiser.zero_grad()
        torch.autograd.backward(loss)
        optimiser.step()
        losses.append(float(loss.detach()))
    assert losses[-1] < 0.6 * losses[0]
