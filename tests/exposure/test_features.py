"""Matches between photographs: a picture shifted by a known amount, and databases that pycolmap wrote."""

from pathlib import Path

import cv2
import numpy as np

from blur2view.arrays import Array
from blur2view.colmap.project import database_matcher, database_names
from blur2view.exposure.features import Features, features_of, match_features, photograph_matcher
from blur2view.images.source import Source

SHIFT = np.array([12.0, -5.0])


def texture(size: tuple[int, int], seed: int = 0) -> np.ndarray:
    """Give spots of all sizes, (H, W) uint8."""
    rng = np.random.default_rng(seed)
    layers = [cv2.GaussianBlur(rng.normal(size=size[::-1]), (0, 0), s) * s for s in (1.5, 3, 6, 12)]
    noise = np.sum(layers, axis=0)
    return np.asarray(255 * (noise - noise.min()) / np.ptp(noise), np.uint8)


def detect(grey: np.ndarray) -> Features:
    """Return the features of a grey picture (H, W) uint8."""
    return features_of(np.repeat(grey[..., None] / np.float32(255), 3, axis=2))


def write_pair(folder: Path, size: tuple[int, int] = (320, 240), shift: Array = SHIFT) -> list[Path]:
    """Write a picture and the same shifted."""
    picture = texture(size)
    moved = cv2.warpAffine(picture, np.column_stack([np.eye(2), shift]), size, borderMode=cv2.BORDER_REFLECT)
    paths = [folder / "a.png", folder / "b.png"]
    for path, pixels in zip(paths, (picture, moved), strict=True):
        assert cv2.imwrite(str(path), pixels)
    return paths


def test_matches_of_a_shifted_picture_are_its_shift(tmp_path: Path) -> None:
    points1, points2 = photograph_matcher([Source(path=path) for path in write_pair(tmp_path)])(0, 1)
    assert len(points1) > 50
    np.testing.assert_allclose(np.median(points2 - points1, axis=0), SHIFT, atol=0.1)
    assert (np.linalg.norm(points2 - points1 - SHIFT, axis=1) < 2).mean() > 0.95


def test_features_lie_at_the_centre_of_their_spot() -> None:
    """Also in a large picture, which is matched smaller: a half pixel forgotten would shift it."""
    for size, at in (((320, 240), (100.0, 90.0)), ((2000, 1600), (801.5, 701.5))):
        x, y = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
        spot = np.exp(-((x - at[0]) ** 2 + (y - at[1]) ** 2) / (2 * (size[0] / 60) ** 2))
        points, _ = detect(np.asarray(20 + 200 * spot, np.uint8))
        assert np.linalg.norm(points - at, axis=1).min() < 0.2 * size[0] / 640 + 0.1


def test_blank_and_unrelated_pictures_have_no_matches() -> None:
    blank = detect(np.full((240, 320), 90, np.uint8))
    one, other = (detect(texture((320, 240), seed)) for seed in (0, 1))
    assert blank[0].shape == (0, 2) and blank[1].shape == (0, 128)  # SIFT's
    for pair in ((blank, one), (one, blank), (one, other)):
        points1, points2 = match_features(*pair)
        assert points1.shape == points2.shape == (0, 2)


def write_database(path: Path, *, inliers: list[list[int]] | None, rows: list[list[int]]) -> None:
    """Write b.jpg (image 1, 5 points) and a.jpg (image 2, 4 points), matched from the first to the second."""
    import pycolmap

    with pycolmap.Database.open(path) as database:
        camera = pycolmap.Camera.create_from_model_name(1, "SIMPLE_PINHOLE", 500.0, 640, 480)
        camera_id = database.write_camera(camera)
        for name, count in (("b.jpg", 5), ("a.jpg", 4)):
            image_id = database.write_image(pycolmap.Image(name=name, camera_id=camera_id))
            points = np.arange(2 * count, dtype=np.float32).reshape(count, 2) + 100 * image_id
            database.write_keypoints(image_id, points)
        database.write_matches(1, 2, np.array(rows, np.uint32))
        if inliers is not None:
            geometry = pycolmap.TwoViewGeometry()
            geometry.inlier_matches = np.array(inliers, np.uint32)
            database.write_two_view_geometry(1, 2, geometry)


def test_database_gives_verified_matches_in_our_pixels_in_either_order(tmp_path: Path) -> None:
    path = tmp_path / "project.db"
    write_database(path, rows=[[0, 1], [2, 3], [4, 0]], inliers=[[0, 1], [2, 3]])
    matcher = database_matcher(path, ["a.jpg", "b.jpg", "c.jpg"])
    a, b = matcher(0, 1)
    np.testing.assert_allclose(b, [[99.5, 100.5], [103.5, 104.5]])
    np.testing.assert_allclose(a, [[201.5, 202.5], [205.5, 206.5]])
    again_b, again_a = matcher(1, 0)
    np.testing.assert_array_equal(again_a, a)
    np.testing.assert_array_equal(again_b, b)
    assert len(matcher(0, 2)[0]) == 0 and len(matcher(0, 0)[0]) == 0
    assert database_names(path) == ["b.jpg", "a.jpg"]
