"""Masks and models where trainers of radiance fields look for them, read back as their loaders do."""

import json
import os
from functools import partial
from pathlib import Path

import numpy as np
import pycolmap
import pytest
from PIL import Image

from blur2view.colmap.models import add_image, read_model
from blur2view.exposure.views import CLOSE, OPEN
from blur2view.results.overlay import png
from tests.colmap.test_transforms import NAMES, POINTS, SMEAR_PX, WALK
from tests.support.calls import Call, call_program

GREYS = np.zeros((64, 96), np.uint8)
GREYS[8:24, 16:64], GREYS[:, 80:] = 255, 128


@pytest.fixture
def call(capsys: pytest.CaptureFixture[str]) -> Call:
    """Return ``blur2view to-transforms`` in this process."""
    return partial(call_program, capsys, "to-transforms")


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    """Return a folder with photographs, of which EXIF turns one, their model with views, and their masks."""
    (tmp_path / "images").mkdir()
    (tmp_path / "out").mkdir()
    for k, name in enumerate(NAMES):
        exif = Image.Exif()
        exif[274] = 6 if k == 1 else 1
        Image.new("RGB", (96, 64)).save(tmp_path / "images" / name, exif=exif)
        upright = np.rot90(GREYS, -1) if k == 1 else GREYS  # EXIF 6: turned clockwise to be looked at
        (tmp_path / "out" / f"{Path(name).stem}.mask.png").write_bytes(png(np.ascontiguousarray(upright)))
    WALK.write(POINTS, tmp_path / "video.db", {tmp_path / "model": range(9)})
    return tmp_path


def test_instant_ngp_finds_a_mask_beside_each_photograph(scene: Path, call: Call) -> None:
    words = (scene / "model", "--images", scene / "images", "--masks-from", scene / "out")
    for _ in range(2):  # and replaces its own
        done = call(*words, "-o", scene / "ngp" / "transforms.json")
        assert done.out.endswith(f"3 frames and their masks, {scene / 'images' / 'dynamic_mask_NAME.png'}\n")
    document = json.loads((scene / "ngp" / "transforms.json").read_text())
    for frame in document["frames"]:
        path = scene / "ngp" / frame["file_path"]
        mask = np.asarray(Image.open(path.parent / f"dynamic_mask_{path.stem}.png"))
        np.testing.assert_array_equal(mask != 0, GREYS == 255)
    (scene / "images" / f"dynamic_mask_{Path(NAMES[0]).stem}.png").write_bytes(b"mine")
    refused = call(*words, "-o", scene / "other.json")
    assert refused == 1 and "was not written by blur2view" in refused.line
    assert not (scene / "other.json").exists()


def test_nerfstudio_finds_a_mask_of_every_frame(scene: Path, call: Call) -> None:
    words = (scene / "model", "--images", scene / "images", "--dialect", "nerfstudio")
    target = scene / "splat" / "transforms.json"
    assert call(*words, "--masks-from", scene / "out", "-o", target) == 0
    frames = json.loads(target.read_text())["frames"]
    assert len(frames) == len(NAMES)
    for frame in frames:
        mask = np.asarray(Image.open(target.parent / frame["mask_path"]))
        np.testing.assert_array_equal(mask == 0, GREYS == 255)
    (scene / "out" / f"{Path(NAMES[2]).stem}.mask.png").unlink()
    refused = call(*words, "--masks-from", scene / "out", "-o", scene / "other.json")
    assert refused == 1 and f"no mask of {NAMES[2]}; make it" in refused.line


def test_gsplat_gets_the_model_of_photographs_that_are_there(scene: Path, call: Call) -> None:
    words = (scene / "model", "--images", scene / "images", "--dialect", "gsplat")
    for _ in range(2):
        assert "3 photographs as sharp at mid exposure" in call(*words, "-o", scene / "splat").out
    read = pycolmap.Reconstruction(scene / "splat" / "sparse" / "0")
    given = pycolmap.Reconstruction(scene / "model")
    assert sorted(image.name for image in read.images.values()) == NAMES
    assert len(read.points3D) == len(given.points3D)
    for image in read.images.values():
        assert (scene / "splat" / "images" / image.name).is_file()
        same = given.find_image_with_name(image.name).cam_from_world()
        np.testing.assert_allclose(image.cam_from_world().matrix(), same.matrix())
    assert call(*words, "-o", scene) == 0 and not (scene / "images").is_symlink()  # they are there already
    (scene / "other" / "images").mkdir(parents=True)
    for wrong, complaint in (
        (("-o", scene / "other"), "is not the folder"),
        (("-o", scene / "b", "--images", scene / "out"), "nor any other"),
    ):
        assert complaint in call(*words, *wrong).line
    assert call(*words, "-o", scene / "b", "--masks-from", scene / "out") == 2  # it reads none
    assert not (scene / "b").exists()


def test_gsplat_hears_which_photographs_are_smeared(scene: Path, call: Call) -> None:
    words = (scene / "model", "--images", scene / "images", "--dialect", "gsplat", "-o", scene / "splat")
    said = f"; 3 of them have smears of more than 3 px, up to {max(SMEAR_PX):.0f} px (--max-smear 3 leaves"
    assert said in call(*words).out
    assert "smears" not in call(*words, "--max-smear", 99).out


def test_gsplat_gets_the_images_of_a_rig_whose_other_photographs_are_not_there(
    scene: Path, call: Call
) -> None:
    options = pycolmap.SyntheticDatasetOptions(
        num_rigs=1, num_cameras_per_rig=2, num_frames_per_rig=3, num_points3D=9
    )
    pycolmap.set_random_seed(0)
    rig = pycolmap.synthesize_dataset(options)
    of_left = [image for image in rig.images.values() if image.camera_id == 1]
    beside = of_left[0]
    for end in (OPEN, CLOSE):
        add_image(rig, beside.name + end, beside.cam_from_world().matrix(), np.ones((9, 2)), beside)
    (scene / "rig").mkdir()
    rig.write(scene / "rig")
    for image in of_left:
        (scene / "images" / image.name).touch()
    words = (scene / "rig", "--images", scene / "images", "--dialect", "gsplat", "-o", scene / "splat")
    assert "wrote 3 photographs as sharp" in call(*words).out
    read = read_model(scene / "splat" / "sparse" / "0")
    assert sorted(image.name for image in read.images.values()) == sorted(image.name for image in of_left)
    for image in read.images.values():
        same = rig.images[image.image_id]
        assert (image.name, image.frame_id) == (same.name, same.frame_id)
        np.testing.assert_allclose(image.cam_from_world().matrix(), same.cam_from_world().matrix())
        assert image.num_points3D == 9 == len(read.points3D)


def test_cameras_are_those_of_the_photographs_size_and_of_a_part_there_is_none(
    scene: Path, call: Call
) -> None:
    words = (scene / "model", "--images", scene / "half", "-o", scene / "half.json")
    (scene / "half").mkdir()
    for name in NAMES:
        Image.new("RGB", (48, 32)).save(scene / "half" / name)
    assert ", cameras scaled to the size of the photographs" in call(*words).out
    half = json.loads((scene / "half.json").read_text())
    assert call(*words[:2], scene / "images", *words[3:]) == 0
    whole = json.loads((scene / "half.json").read_text())
    for key in ("w", "h", "fl_x", "fl_y", "cx", "cy"):
        assert half[key] == whole[key] / 2
    Image.new("RGB", (48, 48)).save(scene / "half" / NAMES[1])
    refused = call(*words)
    assert refused == 1 and "48x48 pixels do not show all 96x64 of its camera; name" in refused.line


def test_what_a_user_changed_since_stays(scene: Path, call: Call) -> None:
    words = (scene / "model", "--images", scene / "images", "-o")
    target = scene / "transforms.json"
    assert call(*words, target) == call(*words, target) == 0
    target.write_text(target.read_text().replace('"aabb_scale": 16', '"aabb_scale": 4'))
    refused = call(*words, target)
    assert refused == 1 and "transforms.json: has changed since blur2view wrote it" in refused.line
    (scene / "scene" / "sparse").mkdir(parents=True)
    (scene / "model").rename(scene / "scene" / "sparse" / "0")
    (scene / "scene" / "sparse" / "0" / "project.ini").write_text("# by blur2view\n")
    own = (scene / "scene" / "sparse" / "0", *words[1:], scene / "scene", "--dialect", "gsplat")
    assert "would replace the model of this call" in call(*own).line


def test_names_that_json_cannot_hold_are_refused(scene: Path, call: Call) -> None:
    folder = (scene / "images").rename(scene / os.fsdecode(b"\xff"))
    refused = call(scene / "model", "--images", folder, "-o", scene / "transforms.json")
    assert refused == 1 and "because it is not UTF-8" in refused.line


def test_masks_that_cannot_be_written_are_named_before_the_work(
    scene: Path, call: Call, monkeypatch: pytest.MonkeyPatch
) -> None:
    (scene / "masks").write_text("a list of masks")
    monkeypatch.setattr("blur2view.cli.to_transforms.stored_labels", None)  # the work
    words = ("--images", scene / "images", "--dialect", "nerfstudio", "--masks-from", scene / "out")
    refused = call(scene / "model", *words, "-o", scene / "transforms.json")
    assert refused == 1 and f"{scene / 'masks'}: is not a folder" in refused.line


def test_an_optimised_mask_is_a_mask(scene: Path, call: Call) -> None:
    mask = scene / "out" / f"{Path(NAMES[0]).stem}.mask.png"
    moves = GREYS == 255
    Image.fromarray(np.where(moves, 255, 0).astype(np.uint8)).convert("1").save(mask)
    words = (scene / "model", "--images", scene / "images", "--masks-from", scene / "out")
    assert call(*words, "-o", scene / "ngp.json") == 0
    written = np.asarray(Image.open(scene / "images" / f"dynamic_mask_{Path(NAMES[0]).stem}.png"))
    np.testing.assert_array_equal(written != 0, moves)


def test_long_smears_are_left_out_and_photographs_that_are_not_there_counted(scene: Path, call: Call) -> None:
    words = (scene / "model", "--images", scene / "images", "-o", scene / "few.json")
    assert call(*words) == 0
    # the walk is even: smears of its frames differ by some percent
    smears = sorted(
        1 / one["sharpness"] - 1 for one in json.loads((scene / "few.json").read_text())["frames"]
    )
    assert " 1 frame\n" in call(*words, "--max-smear", f"{(smears[0] + smears[1]) / 2:.6f}").out
    width = json.loads((scene / "few.json").read_text())["w"]
    assert " 2 frames\n" in call(*words, "--max-smear", f"{50 * (smears[1] + smears[2]) / width:.6f}%").out
    refused = call(*words, "--max-smear", 0.1)
    assert refused == 1 and "all smears are longer than 0.1 px; raise --max-smear" in refused.line
    min((scene / "images").iterdir()).unlink()
    assert f"; left out 1 photograph of the model not in {scene / 'images'}" in call(*words).out
