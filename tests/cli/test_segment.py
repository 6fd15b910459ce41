"""``blur2view segment``: what it prints and writes, and how it fails."""

import json
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from blur2view.images.image import read_image
from blur2view.movers.mask import MotionLabel
from blur2view.movers.moving import THRESHOLD
from blur2view.networks.smear_network import SmearNetwork
from blur2view.pipeline import estimate, segment
from blur2view.smears.blur_map import BlurLabel
from tests.support.calls import Call
from tests.support.colour_code import colour_code, write_picture
from tests.support.many_photographs import contents

HEIGHT, WIDTH = 320, 416
BOX = slice(96, 224), slice(192, 352)
FILES = ("a.mask.png", "a.moving.png", "a.motion.png", "a.motion.json")


@pytest.fixture
def walker(tmp_path: Path) -> Path:
    """Return a picture in which the tiny network sees a still camera and one moving thing."""
    smears = np.zeros((HEIGHT, WIDTH, 2))
    smears[BOX] = (14.0, 3.0)
    cells = np.random.default_rng(0).uniform(
        0.6, 1.4, (HEIGHT // 4, WIDTH // 4)
    )  # a flat picture has no smears
    return write_picture(tmp_path / "a.png", colour_code(smears, np.kron(cells, np.ones((4, 4)))))


@pytest.fixture
def run(call: Call) -> Call:
    """Return ``blur2view segment`` with the tiny network, in this process."""
    return partial(call, "segment")


def test_files_hold_the_mask_and_describe_it(
    run: Call, walker: Path, tiny_model: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    assert run(walker, "-o", out) == 0
    assert sorted(contents(out)) == sorted(FILES)
    image = read_image(walker)
    network = SmearNetwork(tiny_model)
    mask = segment(estimate(image, network=network), image)
    grey = cv2.imread(str(out / "a.mask.png"), cv2.IMREAD_UNCHANGED)
    assert grey is not None and grey.dtype == np.uint8 and grey.shape == mask.labels.shape
    for label, level in zip(MotionLabel, (0, 255, 128), strict=True):
        np.testing.assert_array_equal(grey == level, mask.labels == label)
    levels = cv2.imread(str(out / "a.moving.png"), cv2.IMREAD_UNCHANGED)
    assert levels is not None
    np.testing.assert_allclose(levels / 65535, mask.probability, atol=1e-5)
    document = json.loads((out / "a.motion.json").read_text())
    for name, value in {"static": 0, "moving": 255, "unobservable": 128}.items():
        np.testing.assert_allclose(document["mask"]["shares"][name], (grey == value).mean())
    assert sum(region["area_px"] for region in document["mask"]["regions"]) == (grey == 255).sum()
    assert document["mask"]["reason"] and document["threshold"] == THRESHOLD


@pytest.mark.parametrize(
    ("program", "name", "moving", "static"),
    [
        ("colmap", "a.png.png", 0, 255),
        ("nerfstudio", "a.png", 0, 255),
        ("instant-ngp", "dynamic_mask_a.png", 255, 0),
    ],
)
def test_programs_get_their_masks(
    run: Call, walker: Path, tmp_path: Path, program: str, name: str, moving: int, static: int
) -> None:
    out = tmp_path / "out"
    done = run(walker, "-o", out, "--masks", program, "--masks", "colmap")
    assert done == 0 and str(out / "masks" / name) in done.out
    grey, mask = (np.asarray(Image.open(out / path)) for path in ("a.mask.png", f"masks/{name}"))
    assert (mask[grey == 255] == moving).all() and (mask[grey != 255] == static).all()


@pytest.mark.parametrize("program", ["colmap", "nerfstudio"])
def test_masks_for_programs_are_as_the_pixels_are_stored(
    run: Call, walker: Path, tmp_path: Path, program: str
) -> None:
    exif = Image.Exif()
    exif[0x0112] = 6
    with Image.open(walker) as picture:
        picture.save(tmp_path / "b.png", exif=exif)
    out = tmp_path / "out"
    assert run(tmp_path / "b.png", "-o", out, "--masks", program) == 0
    (mask,) = (np.asarray(Image.open(path)) for path in (out / "masks").iterdir())
    grey = np.asarray(Image.open(out / "b.mask.png"))  # upright
    np.testing.assert_array_equal(mask == 0, np.rot90(grey == 255))


def test_blur_map_is_labels_and_a_picture(run: Call, walker: Path, tmp_path: Path) -> None:
    assert run(walker, "-o", tmp_path / "out", "--blur-map") == 0
    labels = np.asarray(Image.open(tmp_path / "out/a.blur.png"))
    assert labels.shape == (HEIGHT, WIDTH) and set(np.unique(labels)) <= set(BlurLabel)
    assert (tmp_path / "out/a.blur-map.png").exists()
    assert run(walker, "--blur-map") == 2


def test_a_photograph_that_is_too_dark_is_not_said_to_have_no_mover(run: Call, tmp_path: Path) -> None:
    noise = np.random.default_rng(0).integers(0, 4, (64, 64, 3), np.uint8)
    Image.fromarray(noise).save(tmp_path / "dark.png")
    done = run(tmp_path / "dark.png")
    assert done == 0 and done.out.startswith("dark.png: Too dark: cannot tell what moves\n")
