"""Networks that find what moves: trained on drawn scenes, they are files that compute the same."""

from pathlib import Path
from queue import Queue

import numpy as np
import pytest
import torch

from blur2view.networks.model_file import BLUR, UNET, OnnxNetwork
from blur2view.networks.smear_network import SmearNetwork
from tests.tools.rendering.test_layer_scenes import noise_and_disc
from tools.datasets.shards import Example
from tools.training.export import main
from tools.training.mover_networks import BlurNet, UNet
from tools.training.run import Schedule, fit
from tools.training.train_movers import MoverTask, Which, compressed, example, loss_of


@pytest.mark.slow
@pytest.mark.parametrize("which", ["unet", "blur"])
def test_a_network_of_drawn_scenes_is_one_that_the_package_takes(which: Which, tmp_path: Path) -> None:
    torch.manual_seed(0)
    rng = np.random.default_rng(0)
    drawn = [example(which, rng, noise_and_disc(rng), (128, 96), SmearNetwork()) for _ in range(3)]
    queue = Queue[Example]()
    for one in drawn:
        queue.put(one)
    network: UNet | BlurNet = UNet() if which == "unet" else BlurNet()
    task = MoverTask(network, {"batch": 2, "seed": 0}, queue, drawn)
    figures = fit(task, Schedule(out=tmp_path, steps=2, rate=1e-3, largest_gradient=2.0, seed=0, every=2))
    assert figures and all(0 <= value <= 1 for value in figures.values())
    main(which, [tmp_path / "last.pt"] * 2, tmp_path / "file.onnx")
    form = UNET if which == "unet" else BLUR
    fine, cells = (drawn[0][name].astype(np.float32) for name in form.inputs)
    network.load_state_dict(torch.load(tmp_path / "last.pt", weights_only=True)["average"])
    with torch.no_grad():
        said = network.eval()(torch.from_numpy(fine)[None], torch.from_numpy(cells)[None])
    found = OnnxNetwork(form, tmp_path / "file.onnx").run(fine, cells)
    expected = said[0][0, 4] if isinstance(said, tuple) else said[0]
    np.testing.assert_allclose(found[0], expected, atol=0.05)
    assert found[0].shape[-2:] == (24, 32)


def test_the_loss_of_the_u_net_falls_as_the_truth_is_said() -> None:
    rng = np.random.default_rng(0)
    batch = {
        "displacement": torch.from_numpy(rng.normal(0, 6, (2, 2, 8, 8))).float(),
        "moving": torch.from_numpy(rng.integers(0, 2, (2, 8, 8))).float(),
        "share": torch.ones(2, 8, 8),
        "camera": torch.tensor([0.0, 1.0]),
    }
    said = torch.zeros(2, 5, 8, 8)
    said[:, 2:4] = -3
    nothing = loss_of((said, torch.zeros(2)), batch)
    said[:, :2] = compressed(batch["displacement"])
    said[:, 4] = 20 * batch["moving"] - 10
    assert loss_of((said, torch.tensor([-9.0, 9.0])), batch) < nothing - 3
    opposite = {**batch, "displacement": -batch["displacement"]}
    torch.testing.assert_close(compressed(opposite["displacement"]), compressed(batch["displacement"]))
