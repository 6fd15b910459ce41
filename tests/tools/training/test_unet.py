"""The U-Net: scenes of layers whose truth is what was drawn, its losses, and its file."""

from pathlib import Path

import numpy as np
import pytest
import torch

from blur2view.networks.mover_networks import CELL_VALUES, UNET, MoverNetwork
from tools.rendering.layer_scenes import KINDS, LayerScene, Sources, layer_scene
from tools.rendering.sweep import GRID, Layers, swept
from tools.training.export_unet import main
from tools.training.train_unet import compressed, loss_of
from tools.training.unet import UNet


def noise_and_disc(rng: np.random.Generator) -> Sources:
    """Return one photograph, of noise, and one thing, a disc."""
    disc = np.full((64, 64, 4), 200, np.uint8)
    disc[..., 3] = 255 * (np.hypot(*(np.mgrid[:64, :64] - 31.5)) < 30)
    photo = rng.integers(0, 255, (200, 300, 3), dtype=np.uint8)
    return Sources(photographs=[photo], things=[disc])


def scene(kind: str, seed: int) -> LayerScene:
    """Draw a small scene of noise and a disc."""
    rng = np.random.default_rng(seed)
    return layer_scene(rng, noise_and_disc(rng), (96, 64), kind=kind, longest_px=12.0)


@pytest.mark.parametrize("kind", KINDS)
def test_what_moves_by_itself_is_what_was_drawn_so(kind: str) -> None:
    drawn = [scene(kind, seed) for seed in range(4)]
    assert all(one.linear.shape == (64, 96, 3) and one.moving.shape == (16, 24) for one in drawn)
    if kind in ("follow", "cross", "rest"):
        assert max(one.moving.max() for one in drawn) > 0.5
    else:
        assert all(not one.moving.any() for one in drawn)
    if kind in ("rest", "unmoved"):
        still = [np.linalg.norm(one.displacement[one.moving < 0.01], axis=-1) for one in drawn]
        assert max(length.max() for length in still if length.size) < 1.5
        assert all(one.camera_moved == 0 for one in drawn)


def test_a_layer_is_averaged_along_its_displacement() -> None:
    colour = np.zeros((1, 64, 96, 4), np.float32)
    colour[..., 3] = 1
    colour[0, :, 48, :3] = 1
    field = np.zeros((1, 2, 64 // GRID + 1, 96 // GRID + 1), np.float32)
    field[:, 0] = 8
    layers = Layers(colour=colour, displacement=field, margin=0, steps=64, bend=np.zeros(2), acceleration=0.0)
    light, seen = swept(layers, (96, 64))
    np.testing.assert_allclose(seen, 1, atol=1e-5)
    np.testing.assert_allclose(light[32, 45:52], 1 / 8, atol=0.01)
    assert light[32].sum(0) == pytest.approx(1, abs=0.02) and light[32, 55].max() < 1e-6


def test_the_loss_falls_as_the_truth_is_said() -> None:
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


@pytest.mark.slow
def test_file_computes_what_torch_does(tmp_path: Path) -> None:
    torch.manual_seed(0)
    network = UNet().eval()
    torch.save({"unet": network.state_dict(), "step": 3}, tmp_path / "weights.pt")
    main(tmp_path / "weights.pt", tmp_path / "unet.onnx")
    image = torch.rand(96, 64, 3)
    cells = torch.rand(3, 2, CELL_VALUES)
    found = MoverNetwork(UNET, tmp_path / "unet.onnx")(image.numpy(), cells.numpy())
    with torch.no_grad():
        said, camera = network(image.permute(2, 0, 1)[None], cells.permute(2, 0, 1)[None])
    np.testing.assert_allclose(found[0], said[0, 4], atol=0.05)
    assert float(found[1]) == pytest.approx(float(camera), abs=0.05)
