"""A scene of a video: its files, which steps are done again, what is refused, and the report's page."""

import errno
import json
import multiprocessing
import os
import pickle
import re
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
from collections import Counter
from contextlib import AbstractContextManager, closing, nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pycolmap
import pytest
from PIL import ExifTags, Image

from blur2view.arrays import AnyArray
from blur2view.cli.reconstruct import outcome_table
from blur2view.errors import CameraError, DatabaseError, ImageError, OutputError, RunError
from blur2view.images.image import read_image, read_picture
from blur2view.movers.mask import MotionLabel, MotionMask
from blur2view.networks.smear_network import Detail, SmearNetwork
from blur2view.output import locked, write_file
from blur2view.reconstruction import colmap_process, mapping, masks
from blur2view.reconstruction.colmap_process import in_process
from blur2view.reconstruction.frames import (
    Frame,
    chosen,
    colmap_content,
    list_frames,
    plain_names,
    sharp_enough,
    stood_still,
)
from blur2view.reconstruction.masks import MASKS, Masks, write_masks
from blur2view.reconstruction.options import ReconstructionOptions
from blur2view.reconstruction.outcome import Reconstruction, shown_frames
from blur2view.reconstruction.read_once import AllWindows, KeptSmears, LooksAtShort
from blur2view.reconstruction.reconstruct import _digest, reconstruct
from blur2view.reconstruction.scene import STATE, Scene
from blur2view.reconstruction.static_points import Sighted, StaticPoints
from blur2view.reconstruction.timeline import timeline
from blur2view.reconstruction.trainer import write_transforms
from blur2view.smears.grid import SmearGrid
from tests.support.blurred_plane import BlurredPlane
from tests.support.calls import call_program

PLANE = BlurredPlane(frames=7)
REGISTERED = (0, 1, 2, 4, 5, 6)
OPTIONS = ReconstructionOptions(all_frames=True, masks=False)


def quietly(text: str) -> AbstractContextManager[Any]:
    """Show nothing of a step."""
    return nullcontext(lambda done, count: None)


def frames_of(energies: list[float], moved: float) -> list[Frame]:
    """Return frames of these sharpnesses, each as far from the one before."""
    return [Frame(f"f_{k}.png", k, energy, moved) for k, energy in enumerate(energies)]


def test_the_sharpest_of_each_stretch_is_chosen() -> None:
    best = chosen(frames_of([1, 3, 1, 2] * 25, moved=0.02), 25)
    assert len(best) == 25 and {frame.number % 4 for frame in best} == {1}


def test_more_is_chosen_where_the_picture_moves_farther() -> None:
    fast = [Frame(f"f_{k}.png", k, 1.0, 0.1 if k >= 50 else 0.01) for k in range(100)]
    half = sum(frame.number >= 50 for frame in chosen(fast, 40))
    assert half > 25


def test_of_few_frames_all_are_chosen_however_they_are_spread() -> None:
    few = [Frame(f"f_{k}.png", k, 1.0, 0.1 if k >= 20 else 0.001) for k in range(40)]
    assert chosen(few, 300) == few
    assert len(chosen(few, 10)) <= 10


def test_of_a_camera_that_stands_still_a_few_are_chosen() -> None:
    assert len(chosen(frames_of([1.0] * 100, moved=0.0), 300)) == 12


@pytest.mark.parametrize(
    ("smears", "mapped"),
    [
        ([1, 5, 8, 9, 12, 20], ["abc", "abcde", "abcdef"]),
        ([1, 5, 9, 10, 12, 20], ["abcde", "abcdef"]),
        ([1, 13, 13, 20, 20, 20], ["abcdef"]),
        ([None, 5, 8, 9], ["abc", "abcd"]),
        ([9, 9], ["ab"]),
    ],
)
def test_colmap_gets_the_sharpest_of_the_chosen_frames(smears: list[float | None], mapped: list[str]) -> None:
    sets = sharp_enough("abcdef"[: len(smears)], dict(zip("abcdef", smears, strict=False)))
    assert ["".join(names) for names in sets] == mapped


@pytest.mark.parametrize(("moved", "stood"), [(0, True), (1, True), (2, False)])
def test_a_camera_stood_still_if_no_frame_moved_from_the_sharpest(
    tmp_path: Path, moved: int, stood: bool
) -> None:
    rng, picture, paths = np.random.default_rng(0), PLANE.render(0)[..., 0].astype(float), list[Path]()
    for k in range(4):
        shift = moved * (k == 2)
        noisy = np.roll(picture, shift, axis=1) * (1 - 0.1 * k) + rng.normal(scale=2, size=picture.shape)
        paths.append(tmp_path / f"f_{k}.png")
        cv2.imwrite(str(paths[-1]), np.clip(noisy, 0, 255).astype(np.uint8))
    assert stood_still(paths) == stood


def test_where_most_moves_by_itself_or_nothing_is_to_be_seen_no_camera_stood_still(tmp_path: Path) -> None:
    picture = PLANE.render(0)
    other = picture.copy()
    other[:, 80:] = np.roll(picture, 20, axis=0)[:, 80:]
    for name, content in {"a": picture, "b": other, "c": np.full_like(picture, 90)}.items():
        cv2.imwrite(str(tmp_path / f"{name}.png"), content)
    assert stood_still([tmp_path / "a.png"] * 2)
    assert not stood_still([tmp_path / "a.png", tmp_path / "b.png"])
    assert not stood_still([tmp_path / "c.png"] * 2)


def test_a_step_is_done_again_with_all_after_it_if_its_files_are_gone(tmp_path: Path) -> None:
    done = Counter[str]()

    def make(name: str) -> str:
        done[name] += 1
        (tmp_path / "scene" / name).write_text(name)
        return name

    for _ in range(2):
        scene = Scene(tmp_path / "scene", "call")
        for name in "abc":
            assert scene.step(name, [name], partial(make, name)) == name
    assert done == Counter("abc")
    (tmp_path / "scene" / "b").unlink()
    scene = Scene(tmp_path / "scene", "call")
    for name in "abc":
        scene.step(name, [name], partial(make, name))
    assert done == Counter("abcbc")


def test_nothing_of_the_users_is_replaced(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(OutputError, match="holds mine.txt"):
        Scene(tmp_path, "call")
    Scene(tmp_path / "scene", "call")
    with pytest.raises(OutputError, match="of another video, or of other options"):
        Scene(tmp_path / "scene", "another")


def test_a_state_that_was_changed_is_refused_in_one_line(tmp_path: Path) -> None:
    scene = Scene(tmp_path / "scene", "call")
    scene.step("choose", [], lambda: {"frames": ["a.png"]})
    state = tmp_path / "scene" / STATE
    state.write_text(state.read_text().replace("frames", "Frames"))
    with pytest.raises(OutputError, match="is damaged; remove the folder"):
        Scene(tmp_path / "scene", "call")


def test_a_scene_among_the_frames_is_refused(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="is the video, or lies in the folder of its frames"):
        reconstruct(tmp_path, tmp_path / "scene")
    assert not (tmp_path / "scene").exists()


def test_options_that_smears_do_not_support_are_refused() -> None:
    with pytest.raises(ValueError, match="camera model"):
        ReconstructionOptions(camera_model="OPENCV_FISHEYE")
    with pytest.raises(CameraError, match="OPENCV_FISHEYE: fisheye lenses are not supported"):
        ReconstructionOptions(camera="opencv_fisheye 64 48 50 50 32 24 0 0 0 0")


def test_a_camera_is_scaled_to_the_frames_or_refused_before_anything_is_written(tmp_path: Path) -> None:
    options = ReconstructionOptions(camera="simple_radial 640 480 525.1 320 240 0.05")
    assert options.for_colmap((640, 480)) == ("SIMPLE_RADIAL", "525.1,320.0,240.0,0.05")
    model, params = options.for_colmap((1280, 960))
    assert model == "SIMPLE_RADIAL"
    assert [float(one) for one in params.split(",")] == pytest.approx([1050.2, 640, 480, 0.05])
    (tmp_path / "frames").mkdir()
    for name in ("a.png", "b.png", "c.png"):
        cv2.imwrite(str(tmp_path / "frames" / name), np.zeros((90, 160, 3), np.uint8))
    with pytest.raises(CameraError, match="for 640x480 pixels, but the photograph has 160x90"):
        reconstruct(tmp_path / "frames", tmp_path / "scene", options)
    assert not (tmp_path / "scene").exists()


def test_names_that_colmaps_lists_and_json_cannot_hold_are_changed() -> None:
    names = ["a b/c.png", "a_b/c.png", "a\n1.png", "a\udcff2.png", "ä.png"]
    assert plain_names(names) == ["a_b/c.png", "a_b/c_2.png", "a_1.png", "a_2.png", "ä.png"]


def test_a_scene_that_another_call_makes_is_left_to_it(tmp_path: Path) -> None:
    (tmp_path / "frames").mkdir()
    for number in range(3):
        cv2.imwrite(str(tmp_path / "frames" / f"{number}.png"), PLANE.render(0))
    (tmp_path / "scene").mkdir()
    words = [sys.executable, "-m", "blur2view", "reconstruct", str(tmp_path / "frames"), "-o"]
    with locked(tmp_path / "scene", alone=True):
        write_file(tmp_path / "scene" / "a", b"written at once")
        done = subprocess.run([*words, str(tmp_path / "scene")], capture_output=True, text=True)
    assert done.returncode == 1 and "another call writes there; let it end" in done.stderr


def test_a_scene_that_another_thread_makes_is_left_to_it(tmp_path: Path) -> None:
    with locked(tmp_path, alone=True):
        with pytest.raises(OutputError, match="another call writes there"), locked(tmp_path, alone=True):
            pass
        write_file(tmp_path / "a", b"written at once")
    with locked(tmp_path, alone=True):
        pass


def test_frames_that_colmap_does_not_read_become_png(tmp_path: Path) -> None:
    picture = PLANE.render(0)
    for name in ("a.webp", "b.PNG", "c.jp2"):
        Image.fromarray(picture).save(tmp_path / name, lossless=True)
    found = list_frames(tmp_path)
    assert [name for name, _ in found] == ["a.png", "b.PNG", "c.png"]
    first = read_image("a.png", content=colmap_content(found[0][1]))
    assert np.array_equal(np.rint(255 * first), picture)
    assert colmap_content(found[1][1]) == (tmp_path / "b.PNG").read_bytes()


def test_an_animated_gif_is_a_video_and_a_folder_of_videos_is_none(tmp_path: Path) -> None:
    first, second = (Image.fromarray(PLANE.render(k)) for k in (0, 1))
    first.save(tmp_path / "a.gif", save_all=True, append_images=[second])
    shutil.copy(tmp_path / "a.gif", tmp_path / "b.gif")
    assert [name for name, _ in list_frames(tmp_path / "a.gif")] == ["frame_00000.png", "frame_00001.png"]
    with pytest.raises(ImageError, match="is a folder of videos; name one of them"):
        list_frames(tmp_path)


def test_a_video_is_digested_once_in_a_folder_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A digest of each frame would read the whole video as often as it has frames."""
    first, second = (Image.fromarray(PLANE.render(k)) for k in (0, 1))
    first.save(tmp_path / "a.gif", save_all=True, append_images=[second])
    read = list[Path]()
    monkeypatch.setattr("blur2view.reconstruction.reconstruct.quick_digest", lambda path: read.append(path))
    network: Any = SimpleNamespace(model_id="")
    assert _digest(dict(list_frames(tmp_path)), OPTIONS, network) and read == [tmp_path / "a.gif"]


def test_what_is_not_there_or_has_too_few_frames_is_refused_before_anything_is_written(
    tmp_path: Path,
) -> None:
    (tmp_path / "few").mkdir()
    cv2.imwrite(str(tmp_path / "few/1.png"), np.zeros((48, 64), np.uint8))
    for name, why in (("few", "has 1 frame, but a scene needs at least 3"), ("a.mp4", "no such video")):
        with pytest.raises(ImageError, match=why):
            reconstruct(tmp_path / name, tmp_path / "scene")
        assert not (tmp_path / "scene").exists()


def test_a_file_that_is_no_video_is_refused(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((8, 8, 3), np.uint8))
    with pytest.raises(ImageError, match="neither a video nor a folder"):
        reconstruct(tmp_path / "a.png", tmp_path / "scene")


def test_a_camera_that_stands_still_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    picture = PLANE.render(0)
    (tmp_path / "frames").mkdir()
    for k in range(3):
        cv2.imwrite(str(tmp_path / "frames" / f"f_{k}.png"), picture)
    mapped = call_program(capsys, "reconstruct", tmp_path / "frames", "-o", tmp_path / "scene")
    assert mapped == 1 and "COLMAP can make no model: the camera stood still; " in mapped.err
    assert not (tmp_path / "scene" / "transforms.json").exists()


def test_features_of_dull_frames_are_found_in_stretched_copies(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "images").mkdir()
    dull = 60 + PLANE.render(0) // 4
    cv2.imwrite(str(tmp_path / "images" / "f.png"), dull)
    contrast = []

    def find_features(database: Path, images: Path, names: list[str], **given: Any) -> None:
        database.parent.mkdir(exist_ok=True)
        database.touch()
        contrast.append(read_picture(images / names[0]).pixels.std())

    monkeypatch.setattr(mapping, "find_features", find_features)
    monkeypatch.setattr(mapping, "match", lambda *given, **options: None)
    monkeypatch.setattr(mapping, "mapped", lambda *given, **options: [])
    with pytest.raises(DatabaseError, match="no model of 1 frames"):
        mapping.map_frames(
            tmp_path, [["f.png"]], OPTIONS, 1.0, lambda text: nullcontext(lambda done, count: None)
        )
    assert contrast[0] == pytest.approx(dull.std()) and contrast[1] > 1.5 * contrast[0]


def test_colmap_begins_at_the_focal_length_of_exif(tmp_path: Path) -> None:
    for k in range(2):
        photograph = Image.fromarray(PLANE.render(k))
        exif = photograph.getexif()
        exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.FocalLengthIn35mmFilm] = 28
        photograph.save(tmp_path / f"f_{k}.jpg", exif=exif)
    mapping.find_features(
        tmp_path / "m.db", tmp_path, ["f_0.jpg", "f_1.jpg"], camera=("SIMPLE_RADIAL", ""), blurred=False
    )
    with pycolmap.Database.open(tmp_path / "m.db") as database:
        (camera,) = database.read_all_cameras()
    stated = read_picture(tmp_path / "f_0.jpg", as_stored=True).exif.focal_px
    assert camera.has_prior_focal_length and camera.focal_length == pytest.approx(stated, rel=1e-3)


def test_only_an_unknown_focal_length_is_guessed_anew(tmp_path: Path) -> None:
    for name, camera in {"a": ("PINHOLE", ""), "b": ("PINHOLE", "220,220,120,90")}.items():
        cv2.imwrite(str(tmp_path / f"{name}.png"), PLANE.render(0))
        mapping.find_features(
            tmp_path / f"{name}.db", tmp_path, [f"{name}.png"], camera=camera, blurred=False
        )
        mapping._guess_focal_length(tmp_path / f"{name}.db")
        with pycolmap.Database.open(tmp_path / f"{name}.db") as database:
            (known,) = database.read_all_cameras()
        focal_px = 0.85 * 240 if name == "a" else 220
        assert list(known.params) == pytest.approx([focal_px, focal_px, 120, 90])


def test_pairs_of_many_frames_hold_neighbours_and_loops_once() -> None:
    pairs = mapping.pairs_of([str(k) for k in range(200)])
    assert len({frozenset(pair) for pair in pairs}) == len(pairs)
    assert {("0", "1"), ("0", "128"), ("0", "190"), ("71", "199")} <= {*pairs}
    assert ("0", "3") not in pairs and len(pairs) < 200 * 8 + 20 * 10


def test_a_model_that_lost_its_points_is_no_model(
    video: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for number, kept in enumerate((1000, 10)):
        model = pycolmap.Reconstruction(video / "model")
        for point in list(model.points3D)[kept:]:
            model.delete_point3D(point)
        (tmp_path / str(number)).mkdir()
        model.write(tmp_path / str(number))
    monkeypatch.setattr(mapping, "in_process", lambda *given, **options: 2)
    given = tmp_path / "m.db", tmp_path, tmp_path
    assert len(mapping.mapped(*given, mapper="incremental", camera_known=True)) == 1


def test_steps_of_colmap_tell_how_far_they_are(
    video: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    database, told = tmp_path / "m.db", list[tuple[int, int]]()
    frames, names = video / "frames", PLANE.names[:3]

    def in_process(call: Any, *given: Any, watch: Any, **options: Any) -> Any:
        call(*given, **options)
        watch(2)
        return 0

    def show(done: int, count: int) -> None:
        told.append((done, count))

    monkeypatch.setattr(mapping, "in_process", in_process)
    camera = "SIMPLE_RADIAL", ""
    mapping.find_features(database, frames, names, camera=camera, blurred=False, show=show)
    mapping.match(database, names, blurred=False, show=show)
    monkeypatch.setattr(mapping, "_map", lambda *given: 0)
    mapping.mapped(database, frames, tmp_path, mapper="incremental", camera_known=False, show=show)
    assert told == [(3, 3), (3, 3), (2, 3)]


def test_smears_are_read_once_also_by_another_process(tmp_path: Path) -> None:
    network, asked = SmearNetwork(), list[AnyArray]()

    class Counting:
        model_id, execution = network.model_id, network.execution

        def predict(self, image: AnyArray, **options: Any) -> SmearGrid:
            asked.append(image)
            return network.predict(image, **options)

    kept, picture = KeptSmears(Counting(), tmp_path), PLANE.render(3)
    first, again = kept.predict(picture), kept.predict(picture)
    other = pickle.loads(pickle.dumps(KeptSmears(network, tmp_path))).predict(picture)
    assert len(asked) == 1
    assert AllWindows(kept).predict(picture, detail=Detail.RANKING) and len(asked) == 1
    assert kept.predict(picture, detail=Detail.RANKING) and len(asked) == 2
    for grid in (again, other):
        assert vars(grid).keys() == vars(first).keys()
        assert all(np.array_equal(vars(grid)[name], value) for name, value in vars(first).items())


@pytest.mark.parametrize(("smear_px", "asked"), [(3, ["ranking"]), (20, ["ranking", "geometry"])])
def test_poses_have_all_windows_of_long_smears_alone(smear_px: float, asked: list[str]) -> None:
    details = list[str]()

    def predict(image: AnyArray, *, detail: Detail) -> SmearGrid:
        details.append(detail.value)
        cells = np.zeros((6, 8, 4), np.float32)
        cells[..., 0] = smear_px
        return SmearGrid(cells=cells, stride=32, shape=(180, 240))

    reader: Any = SimpleNamespace(model_id="", execution=None, predict=predict)
    LooksAtShort(reader).predict(PLANE.render(0))
    assert details == asked


def tell_twice() -> None:
    """Tell the parent what is done, twice."""
    colmap_process.tell(1)
    colmap_process.tell(2)


def test_a_process_tells_its_parent_what_is_done() -> None:
    told = list[int]()
    in_process(tell_twice, watch=told.append)
    assert told == sorted(told) and {*told} - {0} == {1, 2}  # it looks by itself, too, while nothing is told


def press_and_go_on(ended: Path) -> None:
    """Press Ctrl-C, which the parent answers, and work on."""
    os.kill(os.getppid(), signal.SIGINT)
    time.sleep(120)
    ended.touch()


@pytest.mark.skipif(sys.platform == "win32", reason="Ctrl-C is another signal there")
def test_ctrl_c_ends_what_colmap_does_at_once(tmp_path: Path) -> None:
    others = multiprocessing.active_children()
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # jobs in the background ignore it
    try:
        with pytest.raises(KeyboardInterrupt):
            in_process(press_and_go_on, tmp_path / "ended")
    finally:
        signal.signal(signal.SIGINT, before)
    assert not {*multiprocessing.active_children()} - {*others} and not (tmp_path / "ended").exists()


def test_a_scene_may_be_called_with_marks_of_an_address(tmp_path: Path) -> None:
    database = tmp_path / "a%20b#c?d.db"
    pycolmap.Database.open(database).close()
    assert mapping._rows(database, "SELECT 1") == [(1,)]
    assert [path.name for path in tmp_path.iterdir()] == [database.name]


def test_a_process_of_colmap_that_does_not_start_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def start(process: Any) -> None:
        raise OSError(errno.EAGAIN, os.strerror(errno.EAGAIN))

    monkeypatch.setattr("multiprocessing.context.SpawnProcess.start", start)
    with pytest.raises(RunError, match=r"cannot be started \(Resource temporarily unavailable\); free"):
        in_process(os.getpid)


def test_a_process_of_colmap_that_dies_is_named() -> None:
    with pytest.raises(RunError, match="COLMAP's process died"):
        in_process(os._exit, 1)
    with pytest.raises(ValueError, match="invalid literal"):
        in_process(int, "x")


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with frames of a plane, and the model of all but one."""
    folder = tmp_path_factory.mktemp("video") / "plane"
    PLANE.write(folder, REGISTERED)
    return folder


def let_colmap_make(video: Path, patch: pytest.MonkeyPatch) -> list[str]:
    """Let COLMAP make the model that is there until ``patch`` is undone; return the names of its calls."""
    calls = list[str]()

    def find_features(database: Path, images: Path, names: list[str], **options: Any) -> None:
        calls.append("find")
        database.unlink(missing_ok=True)
        pycolmap.Database.open(database).close()
        pycolmap.import_images(database, images, pycolmap.CameraMode.SINGLE, names)

    def mapped(*given: Any, **options: Any) -> list[Any]:
        calls.append("map")
        return [pycolmap.Reconstruction(video / "model")]

    patch.setattr(mapping, "find_features", find_features)
    patch.setattr(mapping, "match", lambda *given, **options: calls.append("match"))
    patch.setattr(mapping, "mapped", mapped)
    return calls


@pytest.fixture
def colmap(video: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Let COLMAP make the model that is there; return the names of its calls.

    Tests that replace a step once more do so by the same ``monkeypatch``: two would not be undone in order.
    """
    return let_colmap_make(video, monkeypatch)


@pytest.fixture(scope="module")
def scene(video: Path) -> Reconstruction:
    """Return a scene that was made in one call."""
    with pytest.MonkeyPatch.context() as patch:
        let_colmap_make(video, patch)
        return reconstruct(video / "frames", video.parent / "whole", OPTIONS, jobs=1)


@pytest.fixture
def whole(scene: Reconstruction, colmap: list[str]) -> Reconstruction:
    """Return a scene that was made in one call, and let COLMAP make the model that is there."""
    return scene


def test_a_model_that_is_too_small_is_tried_again_before_frames_are_read_anew(
    video: Path, colmap: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(video / "frames", tmp_path / "images")
    (tmp_path / "work").mkdir()
    tries = list[bool]()

    def mapped(*given: Any, again: bool, **options: Any) -> list[Any]:
        tries.append(again)
        if again:
            given[0].write_bytes(b"with another focal length")
        return [pycolmap.Reconstruction(video / "model")] if again else []

    monkeypatch.setattr(mapping, "mapped", mapped)
    before = len(colmap)
    mapping.map_frames(
        tmp_path, [PLANE.names], OPTIONS, 1.0, lambda text: nullcontext(lambda done, count: None)
    )
    assert tries == [False, True] and colmap[before:] == ["find", "match"]
    assert len(mapping._rows(tmp_path / "work" / "matches_0.db", "SELECT name FROM images")) == 7
    assert (tmp_path / "database.db").read_bytes() == b"with another focal length"


def test_more_frames_are_mapped_where_few_of_the_sharpest_are_registered(
    video: Path, tmp_path: Path, colmap: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(video / "frames", tmp_path / "images")
    (tmp_path / "work").mkdir()
    two = pycolmap.Reconstruction(video / "model")
    for image in list(two.images.values())[2:]:
        two.deregister_frame(image.frame_id)
    models = {"matches_0.db": [two], "matches_1.db": [pycolmap.Reconstruction(video / "model")]}
    monkeypatch.setattr(mapping, "mapped", lambda database, *given, **options: models.get(database.name, []))
    sets = PLANE.names[:6], PLANE.names
    found = mapping.map_frames(
        tmp_path, sets, OPTIONS, 1.0, lambda text: nullcontext(lambda done, count: None)
    )
    assert found["mapped"] == PLANE.names
    assert len(mapping._rows(tmp_path / "database.db", "SELECT name FROM images")) == 7


def contents(scene: Path) -> dict[str, bytes]:
    """Return what a scene holds, by paths; COLMAP's database has times in it."""
    files = [path for path in scene.rglob("*") if path.is_file() and "work" not in path.parts]
    kept = [path for path in files if path.suffix not in (".db", ".ini") and ".sha256" not in path.name]
    return {path.relative_to(scene).as_posix(): path.read_bytes() for path in kept}


def test_every_frame_of_a_scene_has_a_pose_and_a_file(whole: Reconstruction) -> None:
    assert len(whole.registered) == 6 and whole.recovered == (PLANE.names[3],) and not whole.refused
    scene = whole.folder
    model = pycolmap.Reconstruction(scene / "sparse" / "0")
    assert {image.name for image in model.images.values()} == {*PLANE.names}
    assert all((scene / "images" / name).is_file() for name in PLANE.names)
    views = {image.name for image in pycolmap.Reconstruction(scene / "exposures").images.values()}
    assert {f"{PLANE.names[3]}#open", f"{PLANE.names[3]}#close"} <= views
    written = json.loads((scene / "transforms.json").read_text())
    assert len(written["frames"]) == 7 and (scene / written["ply_file_path"]).is_file()
    assert all((scene / frame["file_path"]).is_file() for frame in written["frames"])


@pytest.fixture
def moving(monkeypatch: pytest.MonkeyPatch) -> set[str]:
    """Return the frames, by name, of which a corner moves by itself."""
    moving, opened = set[str](), list[str]()

    def opening(path: Path, **options: Any) -> Any:
        opened.append(path.name)
        return read_picture(path, **options)

    def segmented(name: str, image: AnyArray) -> MotionMask:
        labels = np.zeros(image.shape[:2], np.uint8)
        labels[:20, :30] = MotionLabel.MOVING if name in moving else MotionLabel.STATIC
        return MotionMask(labels=labels, probability=labels.astype(np.float32), regions=(), reason="")

    monkeypatch.setattr(masks, "read_picture", opening)
    monkeypatch.setattr(masks, "estimate", lambda pixels, **options: opened[-1])
    monkeypatch.setattr(masks, "segment", segmented)
    return moving


def masked(scene: Path, work: Path, **options: Any) -> Masks:
    """Return what masks of a scene of the plane are written, of whose points nothing is known."""
    points = StaticPoints(scene / "sparse" / "0", PLANE.names)
    points._long.clear()
    return write_masks(scene, "images", PLANE.names, work, SmearNetwork(), points=points, **options)


def test_a_scene_in_which_nothing_moves_has_no_masks(
    whole: Reconstruction, moving: set[str], tmp_path: Path
) -> None:
    scene = Path(shutil.copytree(whole.folder, tmp_path / "scene"))
    assert masked(scene, tmp_path / "work").files == []
    assert not (scene / MASKS).exists()


@pytest.mark.parametrize(("shown", "recovered"), [(True, False), (False, False), (True, True), (False, True)])
def test_what_shows_points_of_the_model_as_the_rest_does_stands_still(
    video: Path, tmp_path: Path, shown: bool, recovered: bool
) -> None:
    model, name = pycolmap.Reconstruction(video / "model"), PLANE.names[2]
    moving = np.zeros(PLANE.render(2).shape[:2], bool)
    moving[40:120, 60:160] = True
    image = model.find_image_with_name(name)
    for index, point in enumerate(image.points2D):
        x, y = np.floor(point.xy).astype(int)
        if not shown and point.has_point3D() and moving[y, x]:
            model.delete_observation(image.image_id, index)
    model.write(tmp_path)
    points = StaticPoints(tmp_path, [name] * recovered)
    assert np.array_equal(points.without_static(name, moving), moving & (not shown))
    assert not points.without_static(name, np.zeros_like(moving)).any()
    wider = moving.copy()
    wider[40:120, 20:200] = True
    left = points.without_static(name, wider)
    assert (left ^ (moving & (not shown))).mean() < (0.12 if recovered else 0.05)


@pytest.mark.parametrize("left", [0, 3])
def test_a_mover_with_few_keypoints_stays_although_its_mask_reaches_over_points_beside_it(
    video: Path, left: int
) -> None:
    points, moving = StaticPoints(video / "model", ()), np.zeros(PLANE.render(2).shape[:2], bool)
    moving[40:120, 60:160] = True
    every = points.sighted(PLANE.names[2])
    x, y = every.pixels.T
    on_it = (x > 62) & (x < 157) & (y > 42) & (y < 117)
    on_it[np.flatnonzero(on_it & every.seen)[:left]] = False
    points.sighted = lambda name: Sighted(every.pixels[~on_it], every.seen[~on_it])  # type: ignore[method-assign]
    assert moving[np.rint(y[~on_it]).astype(int), np.rint(x[~on_it]).astype(int)].any()
    assert np.array_equal(points.without_static(PLANE.names[2], moving), moving)


@pytest.mark.parametrize(("first", "count", "masked_frames"), [(2, 1, 0), (3, 1, 0), (2, 2, 7), (3, 2, 7)])
def test_what_moves_in_one_of_consecutive_frames_alone_is_a_mistake(
    whole: Reconstruction, moving: set[str], tmp_path: Path, first: int, count: int, masked_frames: int
) -> None:
    moving |= set(PLANE.names[first : first + count])
    scene = Path(shutil.copytree(whole.folder, tmp_path / "scene"))
    written = masked(scene, tmp_path / "work", consecutive=True)
    assert len(written.moving) == (count if masked_frames else 0)
    assert len(list(scene.glob(f"{MASKS}/*.png.png"))) == masked_frames
    for name in PLANE.names if masked_frames else ():
        hidden = np.array(Image.open(scene / MASKS / f"{name}.png")) == 0
        assert hidden.sum() == (600 if name in moving else 0)


def test_half_of_the_consecutive_frames_of_a_still_scene_are_segmented(
    whole: Reconstruction, moving: set[str], tmp_path: Path
) -> None:
    work = tmp_path / "work"
    assert masked(whole.folder, work, consecutive=True) == ([], [])
    assert {path.name for path in work.iterdir()} == {f"{name}.png" for name in PLANE.names[::2]}


@pytest.mark.parametrize("moves_at", [None, 4])
def test_a_quarter_of_many_consecutive_frames_in_which_nothing_moves_is_segmented(
    whole: Reconstruction,
    moving: set[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    moves_at: int | None,
) -> None:
    monkeypatch.setattr(masks, "ENOUGH", 2)
    if moves_at is not None:
        moving |= set(PLANE.names[moves_at : moves_at + 2])
    work, scene = tmp_path / "work", Path(shutil.copytree(whole.folder, tmp_path / "scene"))
    written = masked(scene, work, consecutive=True)
    segmented = {PLANE.names.index(path.stem) for path in work.iterdir()}
    assert segmented == ({0, 4} if moves_at is None else {0, 2, 3, 4, 5, 6})
    assert len(written.moving) == (0 if moves_at is None else 2)


@pytest.mark.parametrize("dialect", ["nerfstudio", "instant-ngp"])
def test_where_something_moves_all_frames_have_masks_that_trainers_find(
    whole: Reconstruction, moving: set[str], tmp_path: Path, dialect: str
) -> None:
    moving.add(PLANE.names[2])
    scene = Path(shutil.copytree(whole.folder, tmp_path / "scene"))
    beside = dialect == "instant-ngp"
    written = masked(scene, tmp_path / "work", beside=beside)
    write_transforms(scene, replace(OPTIONS, dialect=dialect), masked=bool(written.files))
    frames = json.loads((scene / "transforms.json").read_text())["frames"]
    named = {frame["file_path"]: frame.get("mask_path") for frame in frames}
    assert set(named.values()) == ({None} if beside else {f"masks/{name}.png" for name in PLANE.names})
    for k, name in enumerate(PLANE.names):
        first, second = (np.array(Image.open(scene / MASKS / one)) for one in (f"{name}.png", name))
        assert np.array_equal(first, second) and (first == 0).sum() == (600 if k == 2 else 0)
        assert not first[:20, :30].any() or k != 2
        ignored = scene / "images" / f"dynamic_mask_f_{k}.png"
        assert ignored.exists() == beside
        assert not beside or (np.array(Image.open(ignored)) == 255 - first).all()


@pytest.mark.parametrize(
    ("moving_frames", "line"),
    [
        (("a", "b"), "  something moves by itself in 2 frames; see masks"),
        ((), "  nothing moves by itself, so that no masks were written"),
        (None, None),
    ],
)
def test_the_table_says_whether_anything_moves(
    whole: Reconstruction, moving_frames: tuple[str, ...] | None, line: str | None
) -> None:
    lines = list(outcome_table(replace(whole, moving=moving_frames)))
    assert [one for one in lines if "by itself" in one] == [line] * (line is not None)


def test_the_report_says_in_how_many_frames_anything_moves(whole: Reconstruction) -> None:
    frames = [Frame(name, k, 1.0, 0.1) for k, name in enumerate(PLANE.names)]
    for moving, row in ((2, "by itself</td><td>2<"), (None, "")):
        shown = shown_frames(frames, {}, whole, {})
        page = timeline(shown, whole.folder / "exposures", whole.folder / "images", "", "", moving=moving)
        assert row in page.decode() and ("by itself" in page.decode()) == bool(row)


@pytest.mark.parametrize(
    ("smears", "line"),
    [
        ([0.0, None, 4.0, 6.0], "frames looked at:              4  2 with smears, 5.0 px in the median"),
        ([0.0, None, 0.0, None], "frames looked at:              4"),
        ([0.0, 4.0, 6.0], "frames looked at:              4"),
    ],
)
def test_the_table_counts_smears_of_frames_that_have_one_where_all_were_read(
    whole: Reconstruction, smears: list[float | None], line: str
) -> None:
    made = replace(whole, looked_at=("a", "b", "c", "d"), smear_px=dict(zip("abcd", smears, strict=False)))
    assert next(outcome_table(made)) == line


def test_a_scene_that_was_ended_after_each_step_is_the_same_at_last(
    whole: Reconstruction, video: Path, tmp_path: Path, colmap: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    steps, noted, before = (
        ["choose", "images", "standing", "look", "map", "recover", "transforms"],
        Scene.step,
        len(colmap),
    )

    def ended(scene: Scene, name: str, files: list[str], work: Any) -> Any:
        new = name not in scene.steps
        result = noted(scene, name, files, work)
        if new:
            raise KeyboardInterrupt
        return result

    with monkeypatch.context() as patch:
        patch.setattr(Scene, "step", ended)
        for _ in steps:
            with pytest.raises(KeyboardInterrupt):
                reconstruct(video / "frames", tmp_path / "scene", OPTIONS, jobs=1)
    made = reconstruct(video / "frames", tmp_path / "scene", OPTIONS, jobs=1)
    assert made.recovered == whole.recovered and colmap[before:] == ["find", "match", "map"]
    assert contents(tmp_path / "scene") == contents(whole.folder)


@pytest.mark.parametrize(
    ("features", "way", "configs", "weak", "why"),
    [
        (50, 1.0, [], False, "fewer than 100 features"),
        (500, 0.01, [], True, "the camera stood still"),
        (500, 1.0, [], False, "no two frames show the same things"),
        (500, 1.0, [6, 6, 2], True, "the camera only turned"),
        (500, 1.0, [2, 2], True, "under 30 points a frame"),
        (500, 1.0, [2, 2], False, "far enough apart"),
    ],
)
def test_why_there_is_no_model_is_told_by_features_motion_pairs_and_points(
    tmp_path: Path, features: int, way: float, configs: list[int], weak: bool, why: str
) -> None:
    with closing(sqlite3.connect(tmp_path / "matches.db")) as opened, opened:
        opened.execute("CREATE TABLE keypoints (rows INTEGER)")
        opened.execute("CREATE TABLE two_view_geometries (config INTEGER, rows INTEGER)")
        opened.execute("INSERT INTO keypoints VALUES (?)", (features,))
        opened.executemany("INSERT INTO two_view_geometries VALUES (?, 20)", [(one,) for one in configs])
    assert why in mapping.why_no_model(tmp_path / "matches.db", way, weak=weak)


@pytest.mark.parametrize(
    ("changed", "lost"),
    [("sparse/0/points3D.bin", "exposures/images.bin"), ("transforms.json", "sparse_pc.ply")],
)
def test_what_a_user_changed_stays_where_what_is_beside_it_is_lost(
    whole: Reconstruction, video: Path, tmp_path: Path, changed: str, lost: str
) -> None:
    scene = Path(shutil.copytree(whole.folder, tmp_path / "scene"))
    (scene / lost).unlink()
    refined = (scene / changed).read_bytes() + b" "
    (scene / changed).write_bytes(refined)
    with pytest.raises(OutputError, match="has changed since blur2view wrote"):
        reconstruct(video / "frames", scene, OPTIONS, jobs=1)
    assert (scene / changed).read_bytes() == refined


def test_the_report_shows_frames_and_path_runs_nothing_and_opens_in_a_browser(whole: Reconstruction) -> None:
    page = (whole.folder / "report.html").read_text()
    assert "<script" not in page and page.count("<svg") == 4
    links = re.findall(r'href="(images/[^"]+)"', page)
    assert len(links) == 7 and all((whole.folder / link).is_file() for link in links)
    assert f"{PLANE.names[3]}, recovered" in page
    browser = shutil.which("chromium")
    if browser is None:
        pytest.skip("Chromium is not installed")
    command = [browser, "--headless", "--no-sandbox", "--disable-gpu", "--dump-dom"]
    shown = subprocess.run([*command, str(whole.folder / "report.html")], capture_output=True, text=True)
    assert shown.returncode == 0 and shown.stdout.count("<svg") == 4 and STATE not in shown.stdout
