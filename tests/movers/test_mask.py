"""Motion masks: movers where they are, none where nothing moves, unobservable where nothing is seen."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from skimage import data

from blur2view.images.image import read_image
from blur2view.movers.mask import MotionLabel, MotionMask, connected_regions
from blur2view.movers.moving import Moving, reduced
from blur2view.pipeline import Estimate, estimate, segment
from blur2view.results import overlay

HEIGHT, WIDTH = 480, 640
BOX = slice(160, 320), slice(352, 544)
SIDEWAYS, MOVER = (12.0, 0.0), (3.0, 24.0)

Floats = NDArray[np.float32]


def smears(camera: tuple[float, float], box: tuple[slice, slice] | None = BOX) -> Floats:
    """Return smears (H, W, 2) of a camera and of a box before it, pixels."""
    displacement = np.full((HEIGHT, WIDTH, 2), camera, np.float32)
    if box is not None:
        displacement[box] = MOVER
    return displacement


def photo(displacement: Floats) -> Floats:
    """Give a photograph (H, W, 3) that is blurred along smears (H, W, 2); what moves shows another one."""
    image = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    for smear in {tuple(one) for one in np.unique(displacement.reshape(-1, 2), axis=0).tolist()}:
        picture = data.astronaut() if smear == MOVER else data.coffee()
        sharp = cv2.resize(picture, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA).astype(np.float32) / 255
        size = 2 * int(max(map(abs, smear))) + 3
        kernel, middle = np.zeros((size, size), np.float32), (size - 1) / 2
        ends = [np.round(16 * (middle + sign * np.array(smear) / 2)).astype(int).tolist() for sign in (-1, 1)]
        cv2.line(kernel, ends[0], ends[1], 1.0, 1, cv2.LINE_AA, 4)
        blurred = cv2.filter2D(sharp, -1, kernel / kernel.sum(), borderType=cv2.BORDER_REFLECT)
        here = (displacement == smear).all(axis=-1)
        image[here] = blurred[here]
    return np.asarray(np.clip(image, 0, 1), np.float32)


ROOT = Path(__file__).parents[2]
SAMPLE = ROOT / "models" / "sample_mover.jpg"
SHARED = ROOT.parent / "shared/data"
REAL = [
    SHARED / name for name in ("real/still_legs.png", "real/gopro_street_07.png", "textures/kodak/12.png")
]
STILL = 0.0, 0.0
LARGE = slice(100, 400), slice(200, 540)


BOXES = {"box": BOX, "large box": LARGE, "nothing": None}


@cache
def before(camera: tuple[float, float], what: str = "box") -> tuple[Floats, Estimate, MotionMask]:
    """Return a photograph of what moves, its estimate and its mask."""
    image = photo(smears(camera, BOXES[what]))
    found = estimate(image)
    return image, found, segment(found, image)


def overlap(mask: MotionMask, box: tuple[slice, slice]) -> float:
    true = np.zeros(mask.labels.shape, bool)
    true[box] = True
    moving = mask.labels == MotionLabel.MOVING
    return float((moving & true).sum() / (moving | true).sum())


@pytest.mark.parametrize("camera", [SIDEWAYS, STILL], ids=["moving camera", "still camera"])
def test_mover_is_found_where_it_is_and_described(camera: tuple[float, float]) -> None:
    _, found, mask = before(camera)
    least, off_px = (0.7, 32) if camera == SIDEWAYS else (0.68, 41)
    assert overlap(mask, BOX) > least
    region = mask.regions[0]
    np.testing.assert_allclose(region.centroid, (447.5, 239.5), atol=off_px)
    assert region.area_px == pytest.approx((mask.labels == MotionLabel.MOVING).sum(), rel=0.1)
    assert region.probability > 3 * mask.probability[mask.labels != MotionLabel.MOVING].mean()
    assert found.blur.kind.of_camera == (camera == SIDEWAYS)
    assert ("stands still" in mask.reason) == (camera == STILL)


def test_mover_of_a_third_of_the_picture_is_not_the_camera() -> None:
    assert overlap(before(SIDEWAYS, "large box")[2], LARGE) > 0.7


@pytest.mark.parametrize("camera", [SIDEWAYS, STILL], ids=["moving camera", "still camera"])
def test_nothing_moves_where_all_smears_are_the_cameras(camera: tuple[float, float]) -> None:
    _, _, mask = before(camera, "nothing")
    assert mask.regions == () and (mask.labels == MotionLabel.STATIC).mean() > 0.8


def test_what_is_smooth_is_unobservable_and_never_moves() -> None:
    image = photo(smears(SIDEWAYS))
    image[:, 352:] = 0.5  # the mover, too
    labels = segment(estimate(image), image).labels
    assert (labels[:, 416:] != MotionLabel.MOVING).all()
    assert (labels[:, 448:] == MotionLabel.UNOBSERVABLE).all()
    plain = np.full((HEIGHT, WIDTH, 3), 0.5, np.float32)
    mask = segment(estimate(plain), plain)
    assert (mask.labels == MotionLabel.UNOBSERVABLE).all()


@pytest.mark.parametrize("shape", [(17, 16), (98, 203), (61, 35)])
def test_any_size_will_do_but_that_of_the_estimate(shape: tuple[int, int]) -> None:
    image, found, _ = before(SIDEWAYS)
    part = np.ascontiguousarray(image[: shape[0], : shape[1]])
    mask = segment(estimate(part), part)
    assert mask.labels.shape == mask.probability.shape == shape
    with pytest.raises(ValueError, match="photograph of the estimate"):
        segment(found, part)


def test_smears_of_another_network_will_do() -> None:
    image, found, mask = before(SIDEWAYS)
    other = replace(found, grid=replace(found.grid, shares=None))
    again = segment(other, image)
    np.testing.assert_array_equal(again.labels, mask.labels)
    np.testing.assert_array_equal(again.probability, mask.probability)  # by the same seed


def test_a_large_photograph_is_halved_and_parts_stay_where_they_are() -> None:
    image = cv2.resize(before(SIDEWAYS)[0], None, fx=3, fy=3, interpolation=cv2.INTER_CUBIC).clip(0, 1)
    found = estimate(image)
    rows, columns = (slice(3 * part.start, 3 * part.stop) for part in BOX)
    mask = segment(found, image)
    assert overlap(mask, (rows, columns)) > 0.6
    motion_px = float(mask.reason.partition("smooth motion of ")[2].split()[0])
    assert motion_px == pytest.approx(3 * SIDEWAYS[0], rel=0.25)


def test_a_lower_threshold_marks_more_and_what_is_no_probability_is_refused() -> None:
    image, found, _ = before(SIDEWAYS)
    high, low = (segment(found, image, threshold=p).labels == MotionLabel.MOVING for p in (0.99, 0.1))
    assert not high.any() and low.any()
    for p in (0.0, 1.0):
        with pytest.raises(ValueError, match="above 0 and below 1"):
            segment(found, image, threshold=p)


def test_parts_are_described_by_their_own_pixels() -> None:
    moving = np.zeros((30, 40), bool)
    moving[2:5, 7] = moving[4, 3:8] = True
    moving[20:28, 10:30] = True
    probability = np.where(moving, 0.5, 0.0).astype(np.float32)
    probability[20:28, 10:20] = 0.9
    large, small = connected_regions(moving, probability)
    assert (large.area_px, small.area_px) == (160, 7)
    assert (large.box, small.box) == ((10, 20, 20, 8), (3, 2, 5, 3))
    assert large.probability == pytest.approx(0.7) and small.probability == pytest.approx(0.5)


def test_overlay_is_pink_on_what_moves_and_refuses_another_size() -> None:
    image, _, mask = before(SIDEWAYS)
    picture = overlay.draw_motion(image, mask).astype(float)
    expected = 0.45 * 255 * image[240, 448] + 0.55 * np.array((255, 70, 170))
    assert np.abs(picture[240, 448] - expected).max() < 20
    assert np.abs(picture[20, 20] - 255 * image[20, 20]).max() < 25
    with pytest.raises(ValueError, match="expected a mask of shape"):
        overlay.draw_motion(image[:100, :100], mask)


@pytest.mark.slow
@pytest.mark.parametrize("photograph", [SAMPLE, *REAL], ids=lambda path: path.stem)
def test_a_photograph_has_one_mask_as_PNG_as_JPEG_and_turned(photograph: Path, tmp_path: Path) -> None:
    if not photograph.exists():
        pytest.skip(f"{photograph} is not here")
    picture, exif = Image.open(photograph).convert("RGB"), Image.Exif()
    picture.thumbnail((480, 480))
    exif[0x0112] = 6  # shown upright after a quarter turn clockwise
    picture.save(tmp_path / "as.png")
    picture.save(tmp_path / "as.jpg", quality=92)
    picture.transpose(Image.Transpose.ROTATE_90).save(tmp_path / "turned.jpg", quality=92, exif=exif)
    images = [read_image(tmp_path / name) for name in ("as.png", "as.jpg", "turned.jpg")]
    one, *others = (segment(estimate(image), image).labels == MotionLabel.MOVING for image in images)
    assert one.any() or photograph != SAMPLE
    assert all((one & other).sum() >= 0.8 * (one | other).sum() for other in others)


@pytest.mark.parametrize(
    ("sharp", "smeared", "camera_moved", "moves"),
    [(0.9, 0.0, 0.1, False), (0.9, 0.0, 0.9, True), (0.1, 0.8, 0.1, True), (0.2, 0.0, 0.1, True)],
)
def test_what_is_in_focus_before_a_camera_at_rest_does_not_move(
    sharp: float, smeared: float, camera_moved: float, moves: bool
) -> None:
    log_odds, kinds = np.full((40, 60), -4, np.float32), np.full((40, 60, 3), (0.2, 0.0, 1.0), np.float32)
    log_odds[10:20, 20:40], kinds[10:20, 20:40] = 3, (sharp, smeared, 1)
    moving = Moving(
        log_odds=log_odds,
        smooth=np.zeros((40, 60), bool),
        block_px=4,
        camera_px=0.0,
        camera_moved=camera_moved,
        kinds=kinds,
    )
    assert moving.parts().any() == moves


@pytest.mark.parametrize(
    ("shape", "factor"), [((1080, 1920), 4.84375), ((1081, 1921), 9.0), ((96, 128), 1.5)]
)
def test_a_reduced_photograph_has_the_means_of_its_pixels(shape: tuple[int, int], factor: float) -> None:
    noise: Floats = np.random.default_rng(0).uniform(0, 255, (*shape, 3)).astype(np.float32)
    image = np.rint(cv2.GaussianBlur(noise, (0, 0), 4)).astype(np.uint8)
    size = [int(np.ceil(side / factor)) for side in shape]
    means = cv2.resize(image, size[::-1], interpolation=cv2.INTER_AREA)
    assert np.abs(reduced(image, factor).astype(float) - means).mean() < 0.3
