"""Scenes of layers: the truth is what was drawn, and a layer is averaged along its displacement."""

import numpy as np
import pytest

from tools.rendering.layer_scenes import GRID, KINDS, LayerScene, Sources, layer_scene, swept


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
    if kind in ("rest", "unmoved", "shallow"):
        still = [np.linalg.norm(one.displacement[one.moving < 0.01], axis=-1) for one in drawn]
        assert max(length.max() for length in still if length.size) < 1.5
        assert all(one.camera_moved == 0 for one in drawn)


@pytest.mark.parametrize("axis", [0, 1])
def test_a_layer_is_averaged_along_its_displacement(axis: int) -> None:
    colour = np.zeros((1, 96, 96, 4), np.float32)
    colour[..., 3] = 1
    colour[0, :, 48, :3] = 1
    field = np.zeros((1, 96 // GRID + 1, 96 // GRID + 1, 2), np.float32)
    field[..., axis] = 8
    colour = colour.swapaxes(1, 2) if axis else colour
    light, seen = swept(colour, field, (96, 96), steps=64, bend=np.zeros(2))
    light = light.swapaxes(0, 1) if axis else light
    np.testing.assert_allclose(seen, 1, atol=1e-5)
    np.testing.assert_allclose(light[32, 45:52], 1 / 8, atol=0.01)
    assert light[32].sum(0) == pytest.approx(1, abs=0.02) and light[32, 55].max() < 1e-6
