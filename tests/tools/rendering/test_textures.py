"""Texture sources: disjoint splits, linear light, seeded generators."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from blur2view.errors import ImageError
from tools.rendering import textures
from tools.rendering.textures import (
    Image,
    photograph,
    photographs,
    sample_texture,
    spectral_noise,
    split_files,
)


def write_pictures(folder: Path, names: list[str]) -> None:
    for level, name in enumerate(names):
        assert cv2.imwrite(str(folder / name), np.full((8, 8, 3), 10 * level, np.uint8))


def test_every_fourth_file_by_name_is_held_out(tmp_path: Path) -> None:
    write_pictures(tmp_path, ["d.png", "a.jpg", "c.jpeg", "b.png", "e.png"])
    (tmp_path / "notes.txt").write_text("not a picture")
    assert [p.name for p in split_files("test", tmp_path)] == ["d.png"]
    train, test = ({p.tobytes() for p in photographs(split, tmp_path)} for split in ("train", "test"))
    assert not train & test and len(train) == 7 + 4 and len(test) == 3 + 1


def test_what_cannot_be_read_is_named_and_what_can_is_rgb(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="validation"):
        photographs("validation")
    (tmp_path / "torn.png").write_bytes(b"\x89PNG")
    with pytest.raises(ImageError, match=r"torn\.png"):
        photographs("train", tmp_path)
    cv2.imwrite(str(tmp_path / "red.png"), np.full((2, 2, 3), (0, 0, 200), np.uint8))
    np.testing.assert_array_equal(textures.read_photograph(tmp_path / "red.png")[0, 0], [200, 0, 0])


def test_srgb_decoding_follows_the_standard() -> None:
    # IEC 61966-2-1: the linear part below 0.04045, and the tabulated value of middle grey
    linear = textures.srgb_to_linear(np.array([0.0, 0.02, 0.5, 1.0]))
    np.testing.assert_allclose(linear, [0, 0.02 / 12.92, 0.214041, 1], atol=1e-6)


@pytest.mark.parametrize(
    "maker", [maker for maker, _ in textures.PROCEDURAL], ids=lambda maker: maker.__name__
)
def test_procedural_texture_is_a_varied_picture_of_its_seed(maker: Callable[..., Image]) -> None:
    first, again, other = (maker(np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert first.shape == (textures.SIZE, textures.SIZE, 3) and first.dtype == np.float32
    assert np.isfinite(first).all() and first.min() > -0.5 and first.max() < 1.5
    assert first.std() > 0.01
    assert first.tobytes() == again.tobytes() != other.tobytes()


def test_spectral_noise_has_the_slope_it_is_asked_for() -> None:
    noise = spectral_noise(np.random.default_rng(0), 256, exponent=1.2)
    assert noise.mean() == pytest.approx(0, abs=1e-5) and noise.std() == pytest.approx(1, abs=1e-5)
    frequency = np.hypot(np.fft.fftfreq(256)[:, None], np.fft.fftfreq(256)[None])
    amplitude, band = np.abs(np.fft.fft2(noise)), (frequency > 0.03) & (frequency < 0.45)
    slope = np.polyfit(np.log(frequency[band]), np.log(amplitude[band]), 1)[0]
    assert slope == pytest.approx(-1.2, abs=0.02)


def test_photograph_is_never_enlarged_nor_reduced_below_128_texels() -> None:
    pool = (np.random.default_rng(0).random((300, 200, 3), np.float32),)
    rng = np.random.default_rng(1)
    shapes = [photograph(rng, pool).shape[:2] for _ in range(40)]
    assert max(max(shape) for shape in shapes) == 300
    assert min(min(shape) for shape in shapes) >= 128
    assert len({shape[0] > shape[1] for shape in shapes}) == 2  # turned, too
    for _ in range(6):
        texture = sample_texture(rng, pool)
        assert texture.dtype == np.float32 and texture.min() >= 0 and np.isfinite(texture).all()


@pytest.mark.parametrize("maker", [textures.panels, textures.plain])
def test_plain_surfaces_are_mostly_plain(maker: Callable[..., Image]) -> None:
    slopes = []
    for seed in range(12):
        picture = maker(np.random.default_rng(seed))
        assert 0 <= picture.min() <= picture.max() <= 1
        slopes.append(np.median(np.abs(np.diff(np.log(picture.mean(2) + 0.01), axis=1))))
    assert np.median(slopes) < 0.02  # an edge here and there, hardly anything between


def test_panels_divide_the_whole_box_without_overlap() -> None:
    parts = textures.divided(np.random.default_rng(3), (0, 0, 512, 512), 60)
    cover = np.zeros((512, 512), int)
    for left, top, right, bottom in parts:
        cover[round(top) : round(bottom), round(left) : round(right)] += 1
    assert len(parts) > 4 and (cover == 1).all()
