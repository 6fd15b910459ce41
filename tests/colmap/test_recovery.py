"""Frames put into a model that lacks them: exact renderings, refusals, what a user's model keeps."""

import errno
import os
import signal
import sqlite3
import sys
from collections.abc import Collection
from contextlib import closing
from copy import deepcopy
from itertools import combinations
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pycolmap
import pytest

from blur2view.arrays import AnyArray, Array
from blur2view.camera import to_colmap
from blur2view.colmap import recovery_run
from blur2view.colmap.blurred_pose import BlurredPose, _shared_out
from blur2view.colmap.blurred_tracks import check_project, track_frames
from blur2view.colmap.frame_sequence import (
    INDEPENDENT_SHARE,
    MAX_DEPARTURE,
    NEAR_FRAMES,
    NO_FIT,
    SPLINE_TAIL,
    FrameSequence,
    RecoveredFrame,
    weighted_mean,
)
from blur2view.colmap.models import observed, registered_images, set_pose
from blur2view.colmap.recovery import Recovery, adjust, recover_frames
from blur2view.colmap.recovery_run import Notes, set_aside_blurred
from blur2view.errors import DatabaseError, OutputError, RunError
from blur2view.exposure.trajectory import CameraPath, Expected, changed, relative_motion
from tests.support.blurred_plane import FOCAL, SIZE, BlurredPlane, ExactSmears

PLANE, MISSING = BlurredPlane(), (3, 4)
COLUMNS = 2, 4, 6  # of keypoints: of learned features, without and with affine shape
REGISTERED = [k for k in range(PLANE.frames) if k not in MISSING]


@pytest.fixture(scope="module")
def network() -> ExactSmears:
    return ExactSmears(PLANE)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a video and a model that lacks two of its frames."""
    path = tmp_path_factory.mktemp("video") / "plane"
    PLANE.write(path, REGISTERED)
    return path


def recover(folder: Path, network: ExactSmears, refine: bool = False) -> Recovery:
    return recover_frames(
        folder / "model",
        folder / "frames",
        PLANE.names,
        views=True,
        refine=refine,
        network=network,  # type: ignore[arg-type]
    )


@pytest.fixture(scope="module")
def recovery(folder: Path, network: ExactSmears) -> Recovery:
    return recover(folder, network)


def poses_of(model: pycolmap.Reconstruction) -> dict[str, Array]:
    return {image.name: image.cam_from_world().matrix() for image in model.images.values()}


def apart(pose: Array, truth: Array) -> tuple[float, float]:
    """Return degrees and distance of two poses."""
    change = relative_motion(pose, truth)
    return float(np.degrees(np.linalg.norm(change[:3]))), float(np.linalg.norm(change[3:]))


@pytest.mark.parametrize("k", MISSING)
def test_recovered_pose_is_a_tenth_as_wrong_as_the_spline(recovery: Recovery, k: int) -> None:
    times = np.array(REGISTERED, float)
    expected = CameraPath(times, np.stack([PLANE.pose(time) for time in times]), NEAR_FRAMES).expected(k)
    found = recovery.recovered[PLANE.names[k]]
    assert expected is not None
    inside, errors = PLANE.inside(PLANE.pixels(k)), []
    for pose in (found.pose, expected.pose):
        missed = (PLANE.pixels(k, pose) - PLANE.pixels(k))[inside]
        errors.append(np.sqrt((missed**2).sum(axis=1).mean()))
    assert errors[0] < min(errors[1] / 10, 0.3)
    error = relative_motion(found.pose, PLANE.pose(k))
    assert error @ np.linalg.solve(found.covariance, error) < 16.8  # 99 % of six degrees of freedom


@pytest.mark.parametrize("k", MISSING)
def test_views_are_both_ends_of_the_exposure_in_order(recovery: Recovery, k: int) -> None:
    poses = {image.name: image.cam_from_world().matrix() for image in recovery.model.images.values()}
    for end, t in (("#open", -0.5), ("#close", 0.5)):
        true = PLANE.pose(k + t * PLANE.share)
        assert apart(poses[PLANE.names[k] + end], true)[0] < apart(PLANE.pose(k), true)[0] / 5


@pytest.mark.parametrize("k", MISSING)
def test_turning_is_known_as_well_as_its_deviation_says(recovery: Recovery, k: int) -> None:
    ends = [PLANE.pose(k + side * PLANE.share / 2) for side in (-1, 1)]
    true = float(np.linalg.norm(relative_motion(*ends)[:3]))
    angle, sigma = recovery.recovered[PLANE.names[k]].turning()
    assert abs(angle - true) < 3 * sigma and 0 < sigma < 0.05 * true


@pytest.mark.parametrize("k", MISSING)
def test_a_point_seen_by_neighbours_is_where_the_surest_of_them_put_it(recovery: Recovery, k: int) -> None:
    found, points = recovery.recovered[PLANE.names[k]], recovery.model.points3D
    world = np.array([points[int(number)].xyz for number in found.points])
    missed = np.linalg.norm(found.pixels - PLANE.seen(PLANE.pose(k), world), axis=1)
    assert missed.max() < 0.8  # of means without weights 0.9, by covariances instead of precisions 1.2


def test_frames_of_the_user_stay_and_tracks_grow(folder: Path, recovery: Recovery) -> None:
    before, after = pycolmap.Reconstruction(folder / "model"), recovery.model
    for number, image in before.images.items():
        assert after.images[number].name == image.name
        assert (after.images[number].cam_from_world().matrix() == image.cam_from_world().matrix()).all()
        assert after.images[number].num_points2D() == image.num_points2D()
    image = after.find_image_with_name(PLANE.names[MISSING[0]])
    frame = recovery.recovered[image.name]
    assert image.num_points3D == len(frame.points) > 100
    for place, number in enumerate(frame.points):
        missed = image.project_point(after.points3D[int(number)].xyz) - image.points2D[place].xy
        assert np.linalg.norm(missed) < 2
    assert not recovery.refused


def test_large_frames_are_worked_on_smaller(
    folder: Path, network: ExactSmears, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("blur2view.colmap.frame_sequence.WORK_SIDE", 180)
    whole = recover(folder, network)
    found = whole.recovered[PLANE.names[MISSING[0]]]
    assert apart(found.pose, PLANE.pose(MISSING[0]))[0] < 0.3
    assert PLANE.inside(found.pixels).all() and np.ptp(found.pixels, axis=0).min() > 120
    world = np.array([whole.model.points3D[int(number)].xyz for number in found.points])
    missed = found.pixels - PLANE.seen(found.pose, world)
    np.testing.assert_allclose(np.median(missed, axis=0), 0, atol=0.08)  # half a pixel of neither size


@pytest.mark.parametrize(
    ("patches", "points", "each"), [(300, 300, 1), (1200, 1200, 1), (2400, 1200, 2), (9999, 1200, 4)]
)
def test_patches_are_shared_out_among_points_and_neighbours(patches: int, points: int, each: int) -> None:
    seen = np.zeros((5, 1500), bool)
    seen[:4, 300:] = True  # the fifth neighbour sees nothing, and nobody sees the first points
    searched = _shared_out(seen, patches)
    assert not (searched & ~seen).any()
    assert (searched.any(axis=0).sum(), searched.sum(axis=0).max()) == (points, each)
    assert np.ptp(searched[:4].sum(axis=1)) <= 1  # neighbours take turns


def test_mean_of_two_equally_sure_poses_lies_half_way() -> None:
    start, sigma = np.eye(3, 4), np.repeat([0.01, 0.1], 3)
    expected = Expected(start, 0.01 / SPLINE_TAIL, 0.1 / SPLINE_TAIL, np.zeros(6))
    change, none = np.array([0.01, 0, 0, 0, 0.2, 0]), np.zeros((0, 2))
    information = np.diag(sigma**-2.0) / INDEPENDENT_SHARE
    found = BlurredPose(
        pose=changed(start, change),
        information=information,
        motion=np.zeros(9),
        motion_covariance=np.eye(9),
        smear_motion=np.zeros(6),
        numbers=np.zeros(0, int),
        pixels=none,
        residual_px=0.0,
        tried=0,
    )
    pose, covariance = weighted_mean(found, expected)
    np.testing.assert_allclose(relative_motion(start, pose), change / 2, atol=1e-3)
    np.testing.assert_allclose(covariance, np.diag(sigma**2) / 2, atol=1e-4)


def test_same_call_gives_same_bytes(
    folder: Path, recovery: Recovery, network: ExactSmears, tmp_path: Path
) -> None:
    written = []
    for name, found in (("first", recovery), ("second", recover(folder, network))):
        (tmp_path / name).mkdir()
        found.model.write(tmp_path / name)
        written.append({path.name: path.read_bytes() for path in (tmp_path / name).iterdir()})
    assert written[0] == written[1]


@pytest.mark.slow
def test_any_number_of_processes_gives_the_same(
    folder: Path, recovery: Recovery, network: ExactSmears
) -> None:
    paths = folder / "model", folder / "frames"
    found = recover_frames(*paths, network=network, jobs=2)  # type: ignore[arg-type]
    assert found.recovered.keys() == recovery.recovered.keys()
    for name, frame in found.recovered.items():
        np.testing.assert_array_equal(frame.pose, recovery.recovered[name].pose)
        np.testing.assert_array_equal(frame.covariance, recovery.recovered[name].covariance)


def test_processes_that_do_not_start_are_named(
    folder: Path, network: ExactSmears, monkeypatch: pytest.MonkeyPatch
) -> None:
    def start(process: object) -> None:
        raise OSError(errno.EAGAIN, os.strerror(errno.EAGAIN))

    monkeypatch.setattr("multiprocessing.context.SpawnProcess.start", start)
    with pytest.raises(RunError, match=r"processes cannot be started .* fewer with --jobs"):
        recover_frames(folder / "model", folder / "frames", network=network, jobs=2)  # type: ignore[arg-type]


def process_of(sequence: FrameSequence, name: str) -> int:
    """Return the process that works on a frame."""
    return os.getpid()


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such signal")
def test_a_process_that_was_killed_while_it_waited_for_the_end_is_not_waited_for(
    folder: Path, network: ExactSmears
) -> None:
    sequence = FrameSequence(folder / "model", folder / "frames", PLANE.names, network)  # type: ignore[arg-type]
    with (
        pytest.raises(RunError, match="a process died, perhaps because of too little memory; add --jobs 1"),
        recovery_run._processes(sequence, 2) as of_each,
    ):
        (process,) = of_each(process_of, PLANE.names[:1])
        os.kill(process, signal.SIGKILL)
        list(of_each(process_of, PLANE.names))  # more than the other process gets before the first is missed


def test_a_killed_call_goes_on_to_the_same_model(
    folder: Path, recovery: Recovery, network: ExactSmears, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried, try_frame = list[str](), FrameSequence.try_frame

    def noted(sequence: FrameSequence, name: str) -> RecoveredFrame | str:
        tried.append(name)
        return try_frame(sequence, name)

    monkeypatch.setattr(FrameSequence, "try_frame", noted)
    notes, paths = tmp_path / "notes.jsonl", (folder / "model", folder / "frames", PLANE.names)
    for _ in range(2):
        found = recover_frames(*paths, views=True, network=network, notes=notes)  # type: ignore[arg-type]
        notes.write_text(notes.read_text()[:-99])  # within the last line
    first, second = found.recovered
    assert tried == [first, second, second]
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
    found.model.write(tmp_path / "first")
    recovery.model.write(tmp_path / "second")
    for path in (tmp_path / "first").iterdir():
        assert path.read_bytes() == (tmp_path / "second" / path.name).read_bytes()


def test_notes_of_another_call_begin_anew_and_other_files_stay(
    folder: Path, network: ExactSmears, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    notes, mine = tmp_path / "notes.jsonl", tmp_path / "mine.jsonl"
    sequence = FrameSequence(folder / "model", folder / "frames", PLANE.names, network)  # type: ignore[arg-type]
    Notes(notes, sequence).add(PLANE.names[3], "of this call")
    assert Notes(notes, sequence).results == {PLANE.names[3]: "of this call"}
    fewer = FrameSequence(folder / "model", folder / "frames", PLANE.names[:-1], network)  # type: ignore[arg-type]
    assert Notes(notes, fewer).results == {}
    mine.write_text("mine")
    Notes(notes, sequence).add(PLANE.names[3], "of this version")
    monkeypatch.setattr(recovery_run, "__version__", "another")
    assert Notes(notes, sequence).results == {}
    with pytest.raises(OutputError, match="was not written by blur2view"):
        Notes(mine, sequence)
    assert mine.read_text() == "mine"


def test_a_note_that_was_damaged_since_is_done_again_and_the_others_are_kept(
    folder: Path, network: ExactSmears, tmp_path: Path
) -> None:
    path, names = tmp_path / "notes.jsonl", PLANE.names
    sequence = FrameSequence(folder / "model", folder / "frames", names, network)  # type: ignore[arg-type]
    notes = Notes(path, sequence)
    for name in names[:4]:
        notes.add(name, f"why {name}")
    first, second, third, fourth, fifth = path.read_bytes().splitlines(keepends=True)
    third = third.replace(b"why", b"WHY")
    path.write_bytes(first + second[:-9] + b"\xff\n" + third + fourth + fifth[:-5])
    assert Notes(path, sequence).results == {names[2]: f"why {names[2]}"}


def write_whole_project(path: Path, model: pycolmap.Reconstruction, lacking: int) -> None:
    """Write the project of a model, and of one frame more that sees all its points; and a stranger."""
    keypoints = {image.image_id: [point.xy for point in image.points2D] for image in model.images.values()}
    seen = {image.image_id: observed(model, image) for image in model.images.values()}
    world = {number: point.xyz for number, point in model.points3D.items()}
    images = [*model.images.values()]
    with pycolmap.Database.open(path) as database:
        database.write_camera(PLANE.camera, use_camera_id=True)
        for rig in model.rigs.values():
            database.write_rig(rig, use_rig_id=True)
        frames = [model.frame(image.frame_id) for image in images]
        for number, name in ((1 + max(keypoints), "other.png"), (99, PLANE.names[lacking])):
            images.append(pycolmap.Image(name=name, camera_id=1, image_id=number))
            frames.append(pycolmap.Frame(frame_id=2 * number, rig_id=1))
            frames[-1].add_data_id(images[-1].data_id)
            keypoints[number] = [*to_colmap(PLANE.seen(PLANE.pose(lacking), np.stack([*world.values()])))]
        seen[99] = dict(enumerate(world))
        for image, frame in zip(images, frames, strict=True):
            database.write_frame(frame, use_frame_id=True)
            database.write_image(image, use_image_id=True)
            database.write_keypoints(image.image_id, np.array(keypoints[image.image_id], np.float32))
        for first, second in combinations(sorted(seen), 2):
            places = [{number: place for place, number in seen[one].items()} for one in (first, second)]
            both = sorted(places[0].keys() & places[1].keys())
            matches = np.array([[one[number] for one in places] for number in both], np.uint32).reshape(-1, 2)
            geometry = pycolmap.TwoViewGeometry()
            geometry.config = pycolmap.TwoViewGeometryConfiguration.CALIBRATED
            geometry.inlier_matches = matches
            database.write_matches(first, second, matches)
            database.write_two_view_geometry(first, second, geometry)


def test_colmap_goes_on_with_the_model_and_its_database(tmp_path: Path, network: ExactSmears) -> None:
    registered = [k for k in range(PLANE.frames) if k != 3]
    PLANE.write(tmp_path / "plane", registered)
    paths, project = (tmp_path / "plane" / "model", tmp_path / "plane" / "frames"), tmp_path / "project.db"
    write_whole_project(project, pycolmap.Reconstruction(paths[0]), 3)
    found = recover_frames(*paths, database=project, keep_keypoints=True, network=network)  # type: ignore[arg-type]
    image = found.model.find_image_with_name(PLANE.names[3])
    assert (image.image_id, image.frame_id) == (99, 198) and image.num_points3D > 100
    for name in ("recovered", "mapped"):
        (tmp_path / name).mkdir()
    found.model.write(tmp_path / "recovered")
    options = pycolmap.IncrementalPipelineOptions(min_model_size=2, num_threads=1, extract_colors=False)
    mapped = pycolmap.incremental_mapping(
        project, paths[1], tmp_path / "mapped", options, input_path=tmp_path / "recovered"
    )
    assert mapped[0].num_reg_images() == PLANE.frames


def test_bundle_adjustment_moves_recovered_frames_alone(folder: Path, network: ExactSmears) -> None:
    refined = recover(folder, network, refine=True).model
    for image in registered_images(refined).values():
        k = PLANE.names.index(image.name)
        degrees, _ = apart(image.cam_from_world().matrix(), PLANE.pose(k))
        assert degrees < (0.3 if k in MISSING else 1e-9)


@pytest.fixture(scope="module")
def wrong(tmp_path_factory: pytest.TempPathFactory, network: ExactSmears) -> tuple[Path, str, float]:
    """Return a model of all frames, that with the longest smears, which is misplaced, and their length."""
    path = tmp_path_factory.mktemp("wrong") / "plane"
    PLANE.write(path, range(PLANE.frames))
    model = pycolmap.Reconstruction(path / "model")
    sequence = FrameSequence(path / "model", path / "frames", PLANE.names, network)  # type: ignore[arg-type]
    lengths = {name: sequence.smear_px(name) for name in PLANE.names[2:-2]}
    name = max(lengths, key=lambda name: lengths[name])
    set_pose(model, name, changed(sequence.poses[name], np.array([0.01, 0.02, 0, 0.1, 0, 0])))
    model.write(path / "model")
    return path, name, lengths[name]


def test_a_registered_frame_with_longer_smears_gets_a_new_pose_and_keeps_the_rest(
    wrong: tuple[Path, str, float], network: ExactSmears
) -> None:
    folder, name, longest = wrong
    paths, before = (
        (folder / "model", folder / "frames", PLANE.names),
        pycolmap.Reconstruction(folder / "model"),
    )
    found = recover_frames(*paths, max_smear_px=longest - 0.01, views=True, network=network)  # type: ignore[arg-type]
    again = set(found.recovered)
    assert name in again and again.isdisjoint(found.registered) and not found.refused
    for number, image in before.images.items():
        other = found.model.images[number]
        assert (other.name, other.num_points3D) == (image.name, image.num_points3D)
        poses = [one.cam_from_world().matrix() for one in (image, other)]
        assert (image.name in again) != (poses[0] == poses[1]).all()
    true = PLANE.pose(PLANE.names.index(name))
    assert apart(found.recovered[name].pose, true)[0] < 0.2 < 1 < apart(poses_of(before)[name], true)[0]
    assert found.model.find_image_with_name(f"{name}#open") is not None


def test_smears_that_were_noted_are_not_read_again(
    wrong: tuple[Path, str, float], network: ExactSmears, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, _, longest = wrong
    given: Any = folder / "model", folder / "frames", PLANE.names, network
    asides, shown = list[list[str]](), list[tuple[int, int]]()
    for jobs in (2, 1):
        sequence = FrameSequence(*given)
        notes = Notes(tmp_path / "notes.jsonl", sequence, longest - 0.01)
        set_aside_blurred(
            sequence, longest - 0.01, jobs=jobs, notes=notes, show=lambda *counts: shown.append(counts)
        )
        asides.append(list(sequence.aside))
        monkeypatch.setattr(FrameSequence, "smear_px", None)
    assert asides[0] == asides[1] and wrong[1] in asides[0]
    assert shown[:2] == [(0, 9), (1, 9)] and shown[-1] == (9, 9)
    assert Notes(tmp_path / "notes.jsonl", FrameSequence(*given), longest).smears == {}


def test_keypoints_that_blur_displaced_move_no_point(
    wrong: tuple[Path, str, float], network: ExactSmears
) -> None:
    model = pycolmap.Reconstruction(wrong[0] / "model")
    before = {number: point.xyz.copy() for number, point in model.points3D.items()}
    with_them = deepcopy(model)
    adjust(with_them, [])
    adjust(model, [], displaced=[wrong[1]])  # whose pose is wrong
    moved = [
        max(np.linalg.norm(one.points3D[number].xyz - place) for number, place in before.items())
        for one in (with_them, model)
    ]
    assert moved[1] < 0.01 * moved[0]


def test_a_registered_frame_that_is_refused_keeps_its_pose(
    wrong: tuple[Path, str, float], network: ExactSmears, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, name, longest = wrong
    monkeypatch.setattr(FrameSequence, "try_frame", lambda sequence, name: "for a reason")
    paths, before = (
        (folder / "model", folder / "frames", PLANE.names),
        pycolmap.Reconstruction(folder / "model"),
    )
    found = recover_frames(*paths, max_smear_px=longest - 0.01, network=network)  # type: ignore[arg-type]
    assert found.registered == tuple(PLANE.names) and not found.recovered and not found.refused
    assert (poses_of(found.model)[name] == poses_of(before)[name]).all()
    with pytest.raises(DatabaseError, match="fewer than two frames with shorter smears"):
        recover_frames(*paths, max_smear_px=0.0, network=network)  # type: ignore[arg-type]


def test_a_point_that_one_frame_sees_stays_where_frames_are_adjusted(
    tmp_path: Path, network: ExactSmears
) -> None:
    PLANE.write(tmp_path / "plane", REGISTERED)
    model = pycolmap.Reconstruction(tmp_path / "plane" / "model")
    number = max(model.points3D)  # the recovered frame does not see this one
    point = model.points3D[number]
    first, place = point.track.elements[0], point.xyz.copy()
    image, keypoint = first.image_id, first.point2D_idx
    model.delete_point3D(number)
    track = pycolmap.Track()
    track.add_element(image, keypoint)
    number = model.add_point3D(place, track)
    model.write(tmp_path / "plane" / "model")
    assert recover(tmp_path / "plane", network, refine=True).model.points3D[number].track.length() == 1


def test_numbers_that_fit_no_motion_refuse_one_frame(
    folder: Path, network: ExactSmears, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail_once(*given: object) -> BlurredPose | None:
        monkeypatch.undo()
        raise np.linalg.LinAlgError("Singular matrix")

    monkeypatch.setattr("blur2view.colmap.frame_sequence.find_pose", fail_once)
    found = recover(folder, network)
    assert list(found.refused.values()) == [NO_FIT] and len(found.recovered) == len(MISSING) - 1


def test_a_frame_a_third_of_the_picture_off_is_searched(
    folder: Path, network: ExactSmears, recovery: Recovery
) -> None:
    class Misled(FrameSequence):
        """Expects a frame by the path a third of the picture off, and knows that it may be."""

        def expected(self, name: str, others: Collection[str] | None = None) -> Expected | None:
            right = super().expected(name, others)
            assert right is not None
            turned = changed(right.pose, np.array([0, SIZE[0] / 3 / FOCAL, 0, 0, 0, 0]))
            return Expected(turned, 0.2, 0.2, right.motion)

    sequence = Misled(folder / "model", folder / "frames", PLANE.names, network)  # type: ignore[arg-type]
    found = sequence.try_frame(PLANE.names[3])
    assert not isinstance(found, str)
    assert apart(found.pose, PLANE.pose(3))[0] < 0.3


def encoded(picture: AnyArray) -> bytes:
    return cv2.imencode(".png", np.asarray(np.clip(picture, 0, 255), np.uint8))[1].tobytes()


OTHER = cv2.GaussianBlur(np.random.default_rng(5).normal(128, 400, SIZE[::-1]), (0, 0), 3)
SPOILT = {
    "too few of its neighbours' points": encoded(OTHER),
    "but the model's camera 240x180": encoded(np.full((90, 120, 3), 99)),
    "damaged": encoded(OTHER)[:300],
}


@pytest.mark.parametrize("reason", SPOILT)
def test_frame_that_does_not_fit_is_refused_with_the_reason(
    tmp_path: Path, network: ExactSmears, reason: str
) -> None:
    PLANE.write(tmp_path / "plane", REGISTERED)
    (tmp_path / "plane" / "frames" / PLANE.names[4]).write_bytes(SPOILT[reason])
    found = recover(tmp_path / "plane", network)
    assert list(found.recovered) == [PLANE.names[3]] and list(found.refused) == [PLANE.names[4]]
    assert reason in found.refused[PLANE.names[4]]


def write_project(path: Path, own: AnyArray) -> None:
    """Write a project whose frames have keypoints of all kinds, the first of them none."""
    with pycolmap.Database.open(path) as database:
        number = database.write_camera(PLANE.camera)
        for k, name in enumerate(PLANE.names):
            image = database.write_image(pycolmap.Image(name=name, camera_id=number))
            if k:
                database.write_keypoints(image, own[:, : COLUMNS[k % 3]])


DAMAGES = {
    "keypoints of image 3: its numbers differ": "UPDATE keypoints SET data = NULL WHERE image_id = 3",
    "has no image f_4.png": "DELETE FROM images WHERE name = 'f_4.png'",
    "has the trigger mine": (
        "CREATE TRIGGER mine AFTER INSERT ON matches BEGIN SELECT RAISE(ABORT, 'no'); END"
    ),
    "its matches are an SQL view": "DROP TABLE matches; CREATE VIEW matches AS SELECT 1 AS pair_id",
}


def test_a_registered_frame_with_few_points_and_off_the_path_or_these_is_misplaced(
    folder: Path, network: ExactSmears
) -> None:
    sequence = FrameSequence(folder / "model", folder / "frames", PLANE.names, network)  # type: ignore[arg-type]
    assert sequence.misplaced() == []
    right, name = sequence.poses["f_6.png"], "f_6.png"
    sequence.poses[name] = changed(right, np.array([1.5, 0, 0, 0, 0, 0]))
    assert sequence.misplaced() == []  # COLMAP saw many points from there
    image = sequence.images[name]
    seen = list(observed(sequence.model, image))
    for index in seen[2 * len(seen) // 5 :]:
        sequence.model.delete_observation(image.image_id, index)
    assert sequence.misplaced() == [name]
    sequence.poses[name] = right
    assert sequence.misplaced() == []
    sequence.poses[name] = changed(right, np.array([0.005, 0, 0, 0, 0, 0]))  # by about a pixel, on the path
    assert sequence._departure(name, sequence.poses.keys() - {name}) < MAX_DEPARTURE
    assert sequence.misplaced() == [name]


@pytest.mark.parametrize("reason", DAMAGES)
def test_project_that_takes_no_tracks_is_refused_before_any_matching(tmp_path: Path, reason: str) -> None:
    write_project(tmp_path / "project.db", np.ones((1, 6), np.float32))
    with closing(sqlite3.connect(tmp_path / "project.db")) as opened:
        opened.executescript(DAMAGES[reason])
        opened.commit()
    with pytest.raises(DatabaseError, match=reason):
        check_project(tmp_path / "project.db", PLANE.names)


def test_tracks_are_where_the_poses_have_them_and_rows_of_the_user_stay(
    folder: Path, recovery: Recovery, tmp_path: Path
) -> None:
    project, tracked = tmp_path / "project.db", tmp_path / "tracks.db"
    own = np.array([[10.0, 20.0, 1.5, 0.1, 0.2, 1.4]], np.float32)
    write_project(project, own)
    before = project.read_bytes()
    track_frames(recovery.sequence, project, tracked)
    assert project.read_bytes() == before
    with pycolmap.Database.open(tracked) as database:
        numbers = {image.name: image.image_id for image in database.read_all_images()}
        ids = [numbers[name] for name in PLANE.names]
        keypoints = [database.read_keypoints(number) for number in ids]
        for k in range(1, PLANE.frames):
            assert (keypoints[k][0] == own[0, : COLUMNS[k % 3]]).all()
        for k in range(1, PLANE.frames):
            geometry = database.read_two_view_geometry(ids[k - 1], ids[k])
            one, other = (
                np.asarray(keypoints[frame][geometry.inlier_matches[:, side], :2] - 0.5, float)
                for side, frame in enumerate((k - 1, k))
            )
            assert len(one) > 50
            missed = np.linalg.norm(PLANE.transferred(one, k - 1, k) - other, axis=1)
            assert np.median(missed) < 0.7
