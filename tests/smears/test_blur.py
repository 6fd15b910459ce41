"""What blurred a photograph: kinds of its cells, averaged where they tell, and more so near the border."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from blur2view.smears import camera_motion
from blur2view.smears.blur import nothing_seen
from blur2view.smears.camera_motion import Evidence, Movers, Needed, blur_of, in_doubt, moved_probability
from blur2view.smears.grid import SmearGrid
from blur2view.smears.likelihood import KINDS, radii_px, read_radii, softmax
from tests.support.grids import grid_of

ROWS, COLUMNS = 12, 16


def grid(kinds: NDArray[np.int_], length: float = 0.3) -> SmearGrid:
    """Return a grid whose cells are surely of these kinds, (h, w) of indices."""
    lengths = np.where(np.isin(kinds, (2, 3)), 9.0, length)
    one = grid_of(lengths[..., None] * [1.0, 0.0], stride=32)
    told = 0.002 + 0.99 * np.eye(len(KINDS))[kinds]
    radii = np.where(np.isin(kinds, (1, 3)), 4.0, 1.0)[..., None]
    blur = np.concatenate([radii, told], -1).astype(np.float32)
    shares = np.zeros((*kinds.shape, 64), np.float32)
    return SmearGrid(cells=one.cells, blur=blur, shares=shares, stride=32, shape=one.shape)


def is_close(one: SmearGrid) -> bool:
    """Return whether more windows may change the name that the cells of a grid give."""
    return camera_motion.is_close(one, Evidence(grid=one).blur)


def within(inside: int, around: int, share: float = 0.5) -> NDArray[np.int_]:
    """Return kinds of a picture with a middle part, of this share of each side."""
    kinds = np.full((ROWS, COLUMNS), around)
    height, width = round(share * ROWS), round(share * COLUMNS)
    top, left = (ROWS - height) // 2, (COLUMNS - width) // 2
    kinds[top : top + height, left : left + width] = inside
    return kinds


@pytest.mark.parametrize(
    ("kinds", "expected"),
    [
        (within(0, 0), "sharp"),
        (within(1, 1), "out of focus"),
        (within(2, 2), "camera moved"),
        (within(3, 3), "out of focus and moved"),
        (within(4, 4), "cannot tell"),
        (within(0, 1, 0.6), "sharp"),  # a subject before what is out of focus
        (within(0, 4, 0.3), "sharp"),  # smooth areas have no say
        (within(2, 0), "camera at rest"),
        (within(0, 2, 0.75), "camera moved"),  # a subject that the camera followed
    ],
)
def test_a_photograph_has_the_name_of_what_blurred_it(kinds: NDArray[np.int_], expected: str) -> None:
    smeared = np.isin(kinds, (2, 3))
    moving = np.where(smeared & (smeared.mean() < 0.3), 1.0, 0.0)  # what a network over the picture says
    assert blur_of(grid(kinds), moving=moving).kind == expected


def test_share_that_moves_is_what_was_asked_for() -> None:
    kinds = within(2, 0)
    assert blur_of(grid(kinds), moving=1.0 * (kinds == 2)).moving_share == pytest.approx(0.25)
    assert blur_of(grid(kinds)).kind == "sharp"  # a smooth part may seem smeared
    assert blur_of(grid(within(2, 2)), moving=1.0 * (kinds == 2)).moving_share == pytest.approx(0.25)


@pytest.mark.parametrize(("camera_moved", "kind"), [(0.9, "camera moved"), (0.1, "camera at rest")])
def test_what_more_than_the_cells_says_of_the_camera_decides(camera_moved: float, kind: str) -> None:
    kinds = within(2, 0)
    assert blur_of(grid(kinds), moving=1.0 * (kinds == 2), camera_moved=camera_moved).kind == kind


@pytest.mark.parametrize(
    ("value", "words"), [(0.0, "too dark"), (1.0, "overexposed"), (0.5, "one colour all over")]
)
def test_a_photograph_that_shows_nothing_says_why(value: float, words: str) -> None:
    shown = blur_of(grid(within(4, 4)), np.full((384, 512, 3), value, np.float32))
    assert shown.nothing_seen.startswith(words) and shown.reason.startswith(words)


def test_a_lens_cap_is_too_dark_though_its_noise_looks_sharp() -> None:
    noise = np.random.default_rng(0).normal(2.2, 1.9, (384, 512, 3))
    cap = np.clip(np.round(noise), 0, 255).astype(np.uint8)
    assert np.quantile(cap, 0.98) == 6
    seen = Evidence(grid=grid(within(0, 0)), nothing_seen=nothing_seen(cap, grid(within(0, 0))))
    assert seen.needed is Needed.NOTHING and seen.blur.kind == "cannot tell"
    assert blur_of(grid(within(0, 0)), cap).nothing_seen == "too dark"


def test_stars_text_on_white_paper_and_dark_pictures_of_16_bits_may_be_seen() -> None:
    sharp, stars = grid(within(0, 0)), np.zeros((384, 512), np.uint8)
    stars[::16, ::16] = 200
    assert not nothing_seen(stars, sharp) and not nothing_seen(255 - stars, sharp)
    deep = np.random.default_rng(0).integers(0, 2000, (384, 512, 3), np.uint16)
    assert not nothing_seen(deep, sharp) and nothing_seen((deep // 256).astype(np.uint8), sharp)


def test_cells_network_and_length_all_weigh_on_whether_the_camera_moved() -> None:
    open_, smeared = grid(within(2, 0)), grid(within(2, 2))
    middle = moved_probability(open_, 0.0, 4.0)
    assert moved_probability(smeared, 0.0, 4.0) > middle
    assert moved_probability(open_, 1.0, 4.0) > middle > moved_probability(open_, 0.0, 1.0)
    movers = Movers(cells=np.zeros((ROWS, COLUMNS)), share=0.0, camera_moved=0.9)
    seen = Evidence(grid=open_, movers=movers)
    assert seen.blur.camera_moved == 0.9 and seen.blur.kind == "camera moved"
    stood = replace(seen, stood_still=True).blur  # as the geometry says
    assert stood.camera_moved == 0 and stood.kind == "sharp"


def test_smears_have_one_direction_whatever_their_signs_and_smooth_cells_no_say() -> None:
    signs = np.random.default_rng(0).choice([-1.0, 1.0], (40, 60, 1))
    for angle in (1.0, 90.0, 179.0):
        phi = np.radians(angle)
        found = blur_of(grid_of(signs * 7 * np.array([np.cos(phi), np.sin(phi)]), 1.0))
        assert found.smear_px == pytest.approx(7, rel=1e-4)
        assert found.direction_deg == pytest.approx(angle, abs=1e-3)
    displacement, sigma = np.zeros((64, 64, 2)), np.full((64, 64), 1000.0)
    assert blur_of(grid_of(displacement, sigma)).kind == "cannot tell"
    displacement[:, :16], sigma[:, :16] = (9.0, 0.0), 2.0
    assert blur_of(grid_of(displacement, sigma)).smear_px == pytest.approx(9)


def test_plain_surfaces_do_not_pull_the_length_down() -> None:
    letters = within(2, 4, 0.4)  # smeared by 9 px, before a plain wall that reads 0.3 px, and knows nothing
    one = grid(letters)
    one.cells[..., 2] = np.where(letters == 2, 0.5, 12.0)
    assert blur_of(one).smear_px == pytest.approx(9, rel=0.01)


def test_cells_that_are_surely_sharp_know_it_and_a_length_below_its_deviation_is_no_blur() -> None:
    sharp, smeared = grid(within(0, 0)), grid(within(2, 2))
    for one in (sharp, smeared):
        one.cells[..., 2] = 5.0
    assert sharp.sigma_px.max() < 0.6 and smeared.sigma_px.min() == 5
    assert blur_of(smeared).kind == "camera moved"
    smeared.cells[..., 2] = 19.0  # of 9 px: the camera moved or stood still
    unknown = blur_of(smeared)
    assert (
        unknown.kind == "cannot tell" and "9.0 px, no longer than their errors of 19.0 px" in unknown.reason
    )


def test_a_kind_is_close_where_a_little_more_would_show_another() -> None:
    halves = np.where(np.arange(COLUMNS) < COLUMNS // 2, 0, 2)[None].repeat(ROWS, 0)
    assert is_close(grid(halves)) and is_close(grid(within(2, 0, 0.2)))
    assert not any(is_close(grid(within(k, k))) for k in range(4))
    for kinds, soft in (
        (within(2, 2), False),
        (within(3, 2, 0.4), True),
    ):  # the large radius is a small octave's
        one = grid(kinds)
        assert one.blur is not None
        one.blur[..., 0] = 2.5
        assert is_close(one) == soft


def test_a_focus_is_close_where_cells_call_sharp_what_the_radius_calls_out_of_focus() -> None:
    one = grid(within(0, 0))
    assert one.blur is not None
    one.blur[..., 0] = 2.5
    assert Evidence(grid=one).blur.kind == "out of focus" and is_close(one)
    assert not is_close(grid(within(1, 1)))


def test_a_look_asks_for_all_windows_and_these_for_networks_where_cells_differ() -> None:
    for every, expected in ((False, Needed.WINDOWS), (True, Needed.MOVERS)):
        assert Evidence(grid=grid(within(2, 0)), closest=every).needed is expected
        assert Evidence(grid=grid(within(0, 0)), closest=every).needed is Needed.NOTHING


def test_the_cells_leave_open_whether_the_camera_moved_where_only_some_of_them_are_smeared() -> None:
    assert in_doubt(grid(within(2, 0))) and in_doubt(grid(within(1, 3)))
    assert not any(in_doubt(grid(within(k, k))) for k in range(5))


def test_logits_are_read_as_probabilities_and_radii() -> None:
    assert softmax(np.zeros((2, 3, 5), np.float32)).sum(-1) == pytest.approx(1)
    logits = np.full((1, 1, 24), -30, np.float32)
    logits[..., 9] = 0
    assert read_radii(logits)[0, 0] == pytest.approx(radii_px(24)[9]) == pytest.approx(2.8, rel=1e-3)


def test_a_photograph_of_another_size_is_refused() -> None:
    for shape in ((0, 0, 3), (384, 500, 3), (4,)):
        with pytest.raises(ValueError, match="expected the photograph of the grid"):
            blur_of(grid(within(4, 4)), np.zeros(shape))
