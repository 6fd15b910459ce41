"""Estimates in Python: what counts as a photograph and as a camera, rates, threads."""

import builtins
import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image

from blur2view.arrays import AnyArray
from blur2view.camera import Camera
from blur2view.errors import ImageError
from blur2view.exposure.sequence import estimate_frames
from blur2view.geometry.pose import rotation_vector
from blur2view.images.image import read_image
from blur2view.images.pixels import as_rgb
from blur2view.networks.model_file import Execution
from blur2view.networks.smear_network import Detail, SmearNetwork
from blur2view.pipeline import Estimate, estimate, segment
from blur2view.records.record import Record
from blur2view.smears.blur import Blur, BlurKind
from blur2view.smears.grid import SmearGrid
from blur2view.smears.likelihood import KINDS, SHARP, SMEARED
from blur2view.smears.matches import select_matches
from blur2view.two_view.estimate import estimate_two_view
from tests.support.calls import Call
from tests.support.colour_code import HEIGHT, WIDTH, colour_code, forward_motion
from tests.support.grids import grid_of

ROOT = Path(__file__).resolve().parents[1]
CAMERA = Camera.from_focal(300.0, (WIDTH, HEIGHT))
PICTURE = colour_code(forward_motion(), 1.0)


@pytest.fixture(scope="module")
def network(tiny_model: Path) -> SmearNetwork:
    return SmearNetwork(tiny_model, threads=1)


def numbers(found: Estimate) -> tuple[str, bytes, bytes]:
    """Return all that an estimate says."""
    cells, ends = found.grid.cells.tobytes(), found.matches.ends.tobytes()
    return Record.from_estimate(found, name="").to_json(), cells, ends


@pytest.mark.parametrize(
    "kind", [np.uint8, np.uint16, np.dtype(">u2"), np.dtype(">f4"), np.float16, np.float64]
)
def test_photograph_is_the_same_of_any_type_contiguous_or_not(kind: Any) -> None:
    top = np.iinfo(kind).max if np.issubdtype(kind, np.integer) else 1
    levels: AnyArray = (np.random.default_rng(0).integers(0, 256, (48, 64, 3)) / 255 * top).astype(kind)
    expected = (levels / top).astype(np.float32)
    for image in (levels, np.asfortranarray(levels), levels[::-1, :, ::-1][::-1, :, ::-1]):
        found = as_rgb(image)
        assert found.dtype == np.float32 and found.flags.c_contiguous
        np.testing.assert_allclose(found, expected, atol=1e-7)


NO_PHOTOGRAPHS: list[Any] = [
    *(np.zeros(shape, np.uint8) for shape in ((40, 40, 2), (40,), (0, 40), (3, 9), (16, 65535))),
    *(np.zeros((40, 40), kind) for kind in (np.int32, bool)),
    *(np.full((40, 40), value) for value in (255.0, np.nan, -0.1)),
    [[0.0]],
    None,
]


@pytest.mark.parametrize("image", NO_PHOTOGRAPHS, ids=repr)
def test_what_is_no_photograph_is_one_value_error(image: Any, network: SmearNetwork) -> None:
    with pytest.raises(ValueError, match="expected|cannot be used") as refused:
        estimate(image, network=network)
    assert "\n" not in str(refused.value)


def test_photograph_may_be_a_path_a_picture_of_pillow_grey_or_transparent(
    network: SmearNetwork, tmp_path: Path
) -> None:
    path, levels = tmp_path / "a.png", np.round(255 * PICTURE).astype(np.uint8)
    picture = Image.fromarray(levels)
    picture.save(path)
    expected = numbers(estimate(levels, network=network))
    for image in (path, str(path), picture):
        assert numbers(estimate(image, network=network)) == expected
    half = np.dstack([levels, np.full(levels.shape[:2], 51, np.uint8)])
    np.testing.assert_allclose(as_rgb(half), 0.5 + 0.2 * (as_rgb(levels) - 0.5), atol=1e-6)
    np.testing.assert_array_equal(as_rgb(Image.fromarray(half)), as_rgb(half))
    np.testing.assert_array_equal(as_rgb(levels[..., :1]), as_rgb(levels[..., 0]))
    deep = levels[..., 0].astype(np.uint16) * 257
    np.testing.assert_array_equal(as_rgb(Image.fromarray(deep)), as_rgb(deep))
    with pytest.raises(ImageError, match="no such file"):
        estimate("absent.jpg", network=network)


@pytest.mark.parametrize("program", [False, True], ids=["estimate", "blur2view estimate"])
def test_photograph_is_read_from_disk_once_and_opened_by_pillow_once(
    program: bool, network: SmearNetwork, call: Call, moving: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read, opened = list[object](), list[object]()
    real_open, open_by_pillow = builtins.open, Image.open

    def noted(file: Any, *rest: Any, **options: Any) -> Any:
        read.extend([file] if str(file) == str(moving) else [])
        return real_open(file, *rest, **options)

    def noted_by_pillow(*rest: Any, **options: Any) -> Any:
        opened.append(rest[0])
        return open_by_pillow(*rest, **options)

    monkeypatch.setattr(builtins, "open", noted)
    monkeypatch.setattr(Image, "open", noted_by_pillow)
    if program:
        assert call("estimate", moving) == 0
    else:
        estimate(moving, network=network)
    assert len(read) == len(opened) == 1


def test_masks_take_a_generator_or_its_seed_and_times_are_finite(network: SmearNetwork) -> None:
    found = estimate(PICTURE, network=network)
    by_seed, by_generator = (segment(found, PICTURE, rng) for rng in (5, np.random.default_rng(5)))
    np.testing.assert_array_equal(by_seed.labels, by_generator.labels)
    with pytest.raises(ValueError, match="must be finite seconds, got nan for frame 1"):
        list(estimate_frames([PICTURE] * 2, timestamps_s=[0.0, np.nan], network=network))


def test_angular_velocity_is_the_rotation_over_the_exposure(network: SmearNetwork) -> None:
    found = estimate(PICTURE, network=network, camera=CAMERA)
    velocity, geometry = found.angular_velocity(0.02), found.geometry
    pose, covariance = geometry.cam2_from_cam1, geometry.covariance
    assert velocity is not None and pose is not None and covariance is not None
    np.testing.assert_allclose(velocity.mean * 0.02, rotation_vector(pose.rotation))
    np.testing.assert_array_equal(velocity.of_gyroscope.mean, -velocity.mean)
    np.testing.assert_allclose(np.degrees(velocity.sigma) * 0.02, covariance.rotation_sigma_deg)
    np.testing.assert_allclose(velocity.covariance * 0.02**2, covariance.matrix[:3, :3])
    assert estimate(PICTURE, network=network).angular_velocity(0.02) is None
    wrong: Any
    for wrong in (0, -1, 1e-320, np.inf, np.nan, 40, "1/30"):
        with pytest.raises(ValueError, match="exposure time must be seconds above 1e-09"):
            found.angular_velocity(wrong)


def test_what_is_no_argument_is_a_value_error_that_says_what_is() -> None:
    size: Any
    for size in (PICTURE.shape, 960, PICTURE):
        with pytest.raises(ValueError, match=r"\(width, height\), as image.shape"):
            Camera.from_focal(800, size)
    for wrong in (None, PICTURE):
        with pytest.raises(
            ValueError, match=r"matches must be a blur2view.SmearMatches, as of select_matches"
        ):
            estimate_two_view(wrong)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="is a folder; pass map"):
        estimate_frames(Path(__file__).parent)
    with pytest.raises(ValueError, match="grid must be a blur2view.SmearGrid, as of network.predict"):
        select_matches(PICTURE)  # type: ignore[arg-type]


class Reader:
    """Network that reads one kind of blur in all windows, and another in the first row of a cheap look."""

    model_id, execution = "made-up", Execution(threads=1)

    def __init__(self, kind: int, differs: bool) -> None:
        self.kind, self.differs, self.details = kind, differs, list[Detail]()

    def predict(self, image: AnyArray, *, detail: Detail = Detail.GEOMETRY) -> SmearGrid:
        """Return the smears of a photograph."""
        self.details.append(detail)
        shape = -(-image.shape[0] // 32), -(-image.shape[1] // 32)
        kinds = np.full(shape, self.kind)
        if self.differs and detail is Detail.RANKING:
            kinds[0] = SMEARED + SHARP - self.kind
        smears = np.where(kinds == SMEARED, 9.0, 0.3)[..., None] * [1.0, 0.0]
        blur = np.concatenate([np.full((*shape, 1), 0.5), np.eye(len(KINDS))[kinds]], -1).astype(np.float32)
        return replace(grid_of(smears, 0.2, stride=32, shape=image.shape[:2]), blur=blur)


@pytest.mark.parametrize("differs", [False, True])
def test_a_cheap_look_that_leaves_the_blur_open_reads_all_windows_and_others_do_not(differs: bool) -> None:
    reader = Reader(SHARP, differs)
    seen = estimate(np.round(255 * PICTURE).astype(np.uint8), network=reader, detail=Detail.RANKING)
    assert reader.details == [Detail.RANKING, Detail.GEOMETRY][: 1 + differs]
    assert seen.blur.kind == "sharp"


@pytest.mark.parametrize("detail", [Detail.RANKING, Detail.GEOMETRY])
def test_what_blurred_a_large_photograph_is_named_by_the_same_looks_for_any_purpose(detail: Detail) -> None:
    reader = Reader(SHARP, differs=True)
    levels = np.random.default_rng(0).integers(0, 256, (800, 900, 3), np.uint8)
    seen = estimate(levels, network=reader, detail=detail)
    last = [Detail.GEOMETRY] if detail is Detail.GEOMETRY else []
    assert reader.details == [Detail.RANKING, Detail.CLOSER, *last] and seen.blur.kind == "sharp"


@pytest.mark.slow
def test_movers_in_a_copy_name_a_large_photograph_and_its_smears_are_measured_in_all_windows(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("blur2view.smears.camera_motion.in_doubt", lambda grid: True)
    image = cv2.resize(read_image(ROOT / "models" / "sample_mover.jpg"), (1080, 720))
    triaged, whole = (
        estimate(image, detail=detail, geometry=False) for detail in (Detail.RANKING, Detail.GEOMETRY)
    )
    assert triaged.blur.kind == whole.blur.kind == "camera moved"
    assert triaged.blur.moving_share == whole.blur.moving_share > 0.05
    assert triaged.moving is not None and triaged.moving.block_px > 4
    assert whole.blur.smear_px == pytest.approx(triaged.blur.smear_px, rel=0.2)
    mask = segment(whole, image)
    assert mask.shares["moving"] == pytest.approx(whole.blur.moving_share, abs=0.05)
    anew = segment(triaged, image).shares  # from all windows, which the look lacks
    assert anew["moving"] == pytest.approx(mask.shares["moving"], abs=0.02)


def test_the_blur_alone_is_that_of_the_whole_estimate(network: SmearNetwork) -> None:
    kinds = []
    for scale in (0.05, 0.1, 0.2, 1.0):  # of the shorter ones a fit may say that the camera stood still
        picture = colour_code(scale * forward_motion(), 1.0)
        whole = estimate(picture, network=network, detail=Detail.RANKING)
        alone = estimate(picture, network=network, detail=Detail.RANKING, geometry=False)
        assert alone.blur == whole.blur and alone.geometry.F is None and alone.geometry.H is None
        kinds.append(alone.blur.kind)
    assert "camera moved" in kinds and "sharp" in kinds


def test_a_photograph_that_is_too_dark_is_read_once_and_has_no_figures() -> None:
    reader = Reader(SMEARED, differs=True)
    seen = estimate(np.full((240, 320, 3), 3, np.uint8), network=reader, detail=Detail.RANKING)
    assert reader.details == [Detail.RANKING]
    assert seen.blur == Blur(kind=BlurKind.CANNOT_TELL, nothing_seen="too dark")
    assert seen.geometry.reason == "cannot tell if the camera moved: too dark"


@pytest.mark.slow
def test_four_threads_with_one_network_give_the_same_bytes(network: SmearNetwork) -> None:
    pictures = [colour_code((0.4 + 0.2 * k) * forward_motion(), 1.0) for k in range(4)]
    alone = [numbers(estimate(picture, network=network, camera=CAMERA)) for picture in pictures]
    with ThreadPoolExecutor(4) as pool:
        together = pool.map(lambda one: numbers(estimate(one, network=network, camera=CAMERA)), 2 * pictures)
        assert list(together) == 2 * alone


@pytest.mark.parametrize("geometry", [False, True])
def test_a_cheap_look_is_enough_for_the_blur_and_not_for_a_geometry(geometry: bool) -> None:
    reader = Reader(SMEARED, differs=False)
    image = np.round(255 * PICTURE).astype(np.uint8)
    estimate(image, network=reader, detail=Detail.RANKING, geometry=geometry)
    assert reader.details == [Detail.RANKING, Detail.GEOMETRY][: 1 + geometry]


def test_an_estimate_gives_the_json_that_the_command_prints(
    run: Call, moving: Path, network: SmearNetwork
) -> None:
    (printed,) = run(moving, "--json", "--focal", 300, "--exposure", 0.04).document["estimates"]
    own = json.loads(
        estimate(moving, network=network, camera=CAMERA).to_json(Path("moving.png"), exposure_s=0.04)
    )
    command = {"beta", "max_error_px", "seed", "input_sha256", "options_sha256"}
    assert {key for key in printed if printed[key] != own[key]} == command
    assert list(own) == list(printed) and own["rate_unit"] == "rad/s"
    assert json.loads(estimate(moving, network=network).to_json(None))["name"] == ""
