"""Motion masks: movers where they are, none where nothing moves, unobservable where nothing is seen."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from blur2view.geometry.rolling_shutter import RollingShutter
from blur2view.images.image import read_image
from blur2view.movers.alike import alike_mean
from blur2view.movers.parts import parts_of
from blur2view.movers.probability import Moving, factor_of, moving_probability, reduced
from blur2view.networks.smear_network import SmearNetwork
from blur2view.pipeline import estimate
from blur2view.results import mask_overlay
from blur2view.segmentation.mask import MotionLabel, MotionMask, segment
from blur2view.segmentation.pixels import moving_parts, moving_regions
from blur2view.smears.blur import BlurKind
from tests.support.grids import grid_of
from tests.support.motion_scenes import (
    BOX,
    HEIGHT,
    MOVER,
    SIDEWAYS,
    WIDTH,
    estimate_of,
    photo,
    sideways,
    with_mover,
)

ROOT = Path(__file__).parents[2]
SAMPLE = ROOT / "models" / "sample_mover.jpg"
REAL = [
    ROOT.parent / "shared/data" / name
    for name in (
        "real/local_walker_0083.png",
        "real/gopro_street_07.png",
        "real/gopro_forward_0950.png",
        "textures/kodak/03.png",
        "textures/kodak/12.png",
        "textures/kodak/17.png",
    )
]


def overlap(mask: MotionMask) -> float:
    true = np.zeros(mask.labels.shape, bool)
    true[BOX] = True
    moving = mask.labels == MotionLabel.MOVING
    return float((moving & true).sum() / (moving | true).sum())


def before_still() -> NDArray[np.float32]:
    smears = np.zeros((HEIGHT, WIDTH, 2), np.float32)
    smears[BOX] = MOVER
    return smears


@pytest.mark.parametrize("smears", [with_mover(), before_still()], ids=["moving camera", "still camera"])
def test_mover_is_found_where_it_is_and_described(smears: NDArray[np.float32]) -> None:
    mask = segment(estimate_of(smears), photo(smears))
    assert overlap(mask) > 0.5
    region = mask.regions[0]
    np.testing.assert_allclose(region.centroid, (447.5, 239.5), atol=16)
    assert region.area_px == (mask.labels == MotionLabel.MOVING).sum()
    assert region.probability > 3 * mask.probability[mask.labels != MotionLabel.MOVING].mean()
    assert mask.probability[240, 448] > 0.6 > 0.2 > mask.probability[60, 60]


def test_what_the_estimate_found_of_a_camera_at_rest_is_not_looked_for_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    image, still = photo(before_still()), estimate_of(before_still())
    still = replace(still, blur=replace(still.blur, kind=BlurKind.CAMERA_AT_REST))
    expected = segment(still, image)
    found = replace(still, moving=moving_probability(image, still.grid))
    monkeypatch.setattr("blur2view.segmentation.mask.moving_probability", lambda *given: pytest.fail("again"))
    np.testing.assert_array_equal(segment(found, image).labels, expected.labels)


def test_mover_is_found_with_the_cameras_F() -> None:
    mask = segment(estimate_of(with_mover(), F=SIDEWAYS), photo(with_mover()))
    assert overlap(mask) > 0.5 and "epipolar lines" in mask.reason


@pytest.mark.slow
def test_F_of_a_rolling_shutter_is_not_compared_with_smears_as_recorded() -> None:
    result = estimate_of(with_mover(), F=SIDEWAYS)
    shutter = RollingShutter(readout_s=0.01, exposure_s=0.02)
    one, other = (segment(replace(result, shutter=each), photo(with_mover())) for each in (None, shutter))
    assert "epipolar lines" in one.reason and "epipolar lines" not in other.reason


def test_mover_of_a_third_of_the_picture_is_not_the_camera() -> None:
    smears = sideways()
    smears[100:400, 200:540] = MOVER
    mask = segment(estimate_of(smears), photo(smears))
    moving = mask.labels == MotionLabel.MOVING
    assert moving[120:380, 230:510].mean() > 0.7 and moving[:60].mean() < 0.05


@pytest.mark.slow
def test_nothing_moves_where_all_smears_are_the_cameras() -> None:
    for smears in (sideways(), np.zeros_like(sideways())):
        mask = segment(estimate_of(smears), photo(smears))
        assert mask.regions == () and (mask.labels == MotionLabel.STATIC).mean() > 0.8


def test_what_is_smooth_is_unobservable_and_never_moves() -> None:
    image = photo(with_mover())
    image[:, 352:] = 0.5  # the mover, too
    labels = segment(estimate_of(with_mover()), image).labels
    assert (labels[:, 416:] != MotionLabel.MOVING).all()
    assert (labels[:, 448:] == MotionLabel.UNOBSERVABLE).all()
    unread = estimate_of(np.zeros_like(sideways()), sigma_px=1000.0, sigma_rad=np.pi / 2)
    mask = segment(unread, np.full((HEIGHT, WIDTH, 3), 0.5, np.float32))
    assert (mask.labels == MotionLabel.UNOBSERVABLE).all() and "no smear" in mask.reason


def test_neither_signs_of_smears_nor_of_time_nor_noise_of_a_level_change_the_mask() -> None:
    image = photo(with_mover())
    one = segment(estimate_of(with_mover(), F=SIDEWAYS), image)
    back = segment(estimate_of(-with_mover(), F=SIDEWAYS.T), image)
    np.testing.assert_array_equal(one.labels, back.labels)
    noise = np.random.default_rng(1).uniform(-1, 1, image.shape) / 255
    noisy = segment(estimate_of(with_mover(), F=SIDEWAYS), np.clip(image + noise, 0, 1).astype(np.float32))
    first, second = (mask.labels == MotionLabel.MOVING for mask in (one, noisy))
    assert (first & second).sum() >= 0.9 * (first | second).sum() > 0


def test_any_size_will_do() -> None:
    for shape in ((17, 16), (98, 203), (61, 35)):
        mask = segment(estimate_of(sideways(shape), F=SIDEWAYS), photo(sideways(shape)))
        assert mask.labels.shape == mask.probability.shape == shape


def test_another_photograph_is_refused() -> None:
    result = estimate_of(sideways())
    with pytest.raises(ValueError, match="photograph of the estimate"):
        segment(result, photo(sideways((64, 64))))


def test_smears_without_rays_of_a_distorted_camera_do_no_harm() -> None:
    from blur2view.camera.camera import Camera

    camera = Camera.from_string(f"SIMPLE_RADIAL {WIDTH} {HEIGHT} 440 320 240 -0.35")
    result = replace(estimate_of(with_mover(), F=SIDEWAYS), camera=camera)
    assert np.isfinite(segment(result, photo(with_mover())).probability).all()


def test_a_part_is_judged_by_its_peak_and_reaches_halfway_down_to_the_median() -> None:
    odds, known = np.full((80, 80), -10, np.float32), np.ones((80, 80), bool)
    odds[:20, :20] = odds[40:60, :20] = odds[:20, 40:60] = -2
    odds[20:40, :20] = -6
    odds[5, 5] = 4
    odds[45, 5] = 0
    odds[70:, :] = 9
    known[70:, :] = False
    part = parts_of(odds, known)
    assert part[10, 10] > 0.8 > part[50, 10] > 0.5 > part[10, 50] > 0  # sure; unsure; unlikely
    assert part[30, 10] == part[30, 30] == part[75, 5] == 0  # low, none, and smooth
    assert (part[:20, :20] == part[0, 0]).all()


def test_places_of_a_like_colour_nearby_have_a_say() -> None:
    colour = np.zeros((60, 80, 3), np.float32)
    colour[:, 40:] = 0.5
    values, known = np.zeros((60, 80), np.float32), np.ones((60, 80), bool)
    values[20:30, 30:50] = 1
    values[:, :3], known[:, :3] = 100, False
    mean = alike_mean(values, colour, known)
    assert np.abs(mean[:, :38].max(axis=1) - mean[:, 42:].max(axis=1)).max() < 0.1
    assert mean[25, 35] > 2 * mean[25, 10] > 0 and mean[:, 3:].max() < 1
    values[:, 40:] = -1
    np.testing.assert_allclose(alike_mean(values, colour, known)[:, :38], mean[:, :38], atol=0.02)


def test_smears_of_a_large_photograph_are_averaged_and_parts_stay_where_they_are() -> None:
    smears = np.full((63, 94, 2), (8.0, 0.0))
    grid = grid_of(smears, 1.0, stride=32, shape=(2010, 3000))
    assert factor_of(grid) == 2
    small = reduced(grid, 2, (1005, 1500))
    assert small.cells.shape[:2] == (32, 47)
    np.testing.assert_allclose(small.smears().displacement, np.full((32, 47, 2), (4.0, 0.0)), atol=1e-6)
    np.testing.assert_allclose(small.smears().sigma_px, 0.5)
    part = np.zeros((256, 376), np.float32)
    part[248:252] = 0.9  # of pixels 1984 to 2015, which the last row of cells shows
    zeros = np.zeros_like(part)
    moving = Moving(
        odds=zeros,
        moving=zeros,
        read=zeros,
        part=part,
        smooth=zeros > 0,
        place_px=8,
        camera_px=0.0,
        with_lines=False,
    )
    share = moving.share_of(grid, 0.5)
    assert share[-1] == pytest.approx(1) and share[:-1] == pytest.approx(0)


def test_outlines_of_parts_that_move_follow_the_picture() -> None:
    part = np.zeros((20, 20), np.float32)
    part[2:12, 2:12], part[14:, 14:] = 0.9, 0.4
    image = np.zeros((80, 80, 3), np.uint8)
    image[8:50, 8:50] = image[56:, 56:] = 200
    expected = np.zeros((80, 80), bool)
    expected[8:50, 8:50] = True
    assert (moving_parts(part, image, 0.5) != expected).mean() < 0.02
    expected[56:, 56:] = True
    assert (moving_parts(part, image, 0.3) != expected).mean() < 0.02
    assert not moving_parts(part, image, 0.95).any()


def test_a_lower_threshold_marks_more_and_what_is_no_probability_is_refused() -> None:
    found = estimate_of(with_mover(), F=SIDEWAYS)
    marked = [
        (segment(found, photo(with_mover()), threshold=p).labels == MotionLabel.MOVING) for p in (0.9, 0.1)
    ]
    assert marked[0].sum() <= marked[1].sum() and not (marked[0] & ~marked[1]).any()
    for p in (0.0, 1.0):
        with pytest.raises(ValueError, match="above 0 and below 1"):
            segment(found, photo(with_mover()), threshold=p)


def test_parts_are_described_by_their_own_pixels() -> None:
    moving = np.zeros((30, 40), bool)
    moving[2:5, 7] = moving[4, 3:8] = True
    moving[20:28, 10:30] = True
    probability = np.where(moving, 0.5, 0.0).astype(np.float32)
    probability[20:28, 10:20] = 0.9
    large, small = moving_regions(moving, probability)
    assert (large.area_px, small.area_px) == (160, 7)
    assert (large.box, small.box) == ((10, 20, 20, 8), (3, 2, 5, 3))
    assert large.probability == pytest.approx(0.7) and small.probability == pytest.approx(0.5)


def test_overlay_is_pink_on_what_moves_and_refuses_another_size() -> None:
    image = photo(with_mover())
    mask = segment(estimate_of(with_mover(), F=SIDEWAYS), image)
    picture = mask_overlay.draw_motion(image, mask)
    pink = np.abs(
        picture[240, 448].astype(float) - 0.45 * 255 * image[240, 448] - 0.55 * np.array((255, 70, 170))
    )
    assert pink.max() < 20 and np.abs(picture[20, 20] - 255 * image[20, 20]).max() < 25
    assert "moving part" in mask_overlay.mask_verdict(mask)
    with pytest.raises(ValueError, match="expected a mask of shape"):
        mask_overlay.draw_motion(image[:100, :100], mask)


@pytest.mark.slow
@pytest.mark.parametrize("photograph", [SAMPLE, *REAL], ids=lambda path: path.stem)
def test_a_photograph_has_one_mask_as_PNG_as_JPEG_and_turned(photograph: Path, tmp_path: Path) -> None:
    if not photograph.exists():
        pytest.skip(f"{photograph} is not here")
    picture = Image.open(photograph).convert("RGB")
    picture.save(tmp_path / "as.png")
    picture.save(tmp_path / "as.jpg", quality=92)
    exif = Image.Exif()
    exif[0x0112] = 6  # shown upright after a quarter turn clockwise
    turned = picture.transpose(Image.Transpose.ROTATE_90)
    turned.save(tmp_path / "turned.jpg", quality=92, exif=exif)
    network = SmearNetwork()
    images = [read_image(tmp_path / name) for name in ("as.png", "as.jpg", "turned.jpg")]
    one, *others = [
        segment(estimate(image, network=network), image).labels == MotionLabel.MOVING for image in images
    ]
    assert one.any() or photograph != SAMPLE
    for other in others:
        assert (one & other).sum() >= 0.8 * (one | other).sum()
