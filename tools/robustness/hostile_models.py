"""COLMAP models with views, and what lies beside them, of which one thing is not what it should be."""

import os
import shutil
import struct
from pathlib import Path

import numpy as np
import pycolmap

from blur2view.colmap.link import write_links
from tools.database_safety.colmap_projects import ProjectOptions, make_project
from tools.database_safety.kill_writes import link_jobs
from tools.robustness.damage import Rng, cut
from tools.robustness.hostile_files import blurred, no_picture
from tools.robustness.hostile_lists import NUMBERS
from tools.robustness.hostile_results import PLACES

DATABASE, MODEL, FRAMES, SIZE = "project.db", "model", "frames", (120, 90)
OF_MODELS = (
    ("place", DATABASE, MODEL, FRAMES, "-o", "out"),
    ("to-transforms", MODEL, "--images", FRAMES, "-o", "transforms.json"),
    ("to-transforms", MODEL, "--dialect", "nerfstudio", "--exposure", "0.02", "-o", "transforms.json"),
)
NAMES = [f"a_{number:03d}.jpg" for number in range(3)]
WORDS = (
    "nan", "-1", "1e999", "0", "x", "", "9" * 30, "SIMPLE_RADIAL", "..", "\0", "\x1b[2J", "a_000.jpg#open",
)  # fmt: skip


def put_model(folder: Path, words: tuple[str, ...], *, seed: tuple[int, ...]) -> None:
    """Put frames, a project with their views, and a model of them into the folder of a call; spoil one."""
    rng = np.random.default_rng(seed)
    database, model, frames = folder / DATABASE, folder / MODEL, folder / FRAMES
    make_project(database, ProjectOptions(wal=rng.random() < 0.3, size=SIZE), seed=seed[-1])
    write_links(database, link_jobs(database, rng), backup=False)
    frames.mkdir()
    for name in NAMES:
        blurred(rng, SIZE).save(frames / name, "JPEG")
    model.mkdir()
    views = words[0] == "to-transforms" or rng.random() < 0.2
    reconstruction = _reconstruction(rng, views)
    if text := rng.random() < 0.5:
        reconstruction.write_text(model)
    else:
        reconstruction.write_binary(model)
    chosen = sorted(model.iterdir())[int(rng.integers(len(list(model.iterdir()))))]
    match int(rng.integers(8)):
        case 0:
            chosen.write_bytes(cut(chosen.read_bytes(), rng))
        case 1 | 2 | 3:
            (_odd_word if text else _odd_number)(chosen, rng)
        case 4:
            chosen.write_bytes(no_picture(rng))
        case 5:
            chosen.unlink()
            if rng.random() < 0.5:
                os.mkfifo(chosen)
            else:
                chosen.symlink_to(str(rng.choice(PLACES)))
        case 6:
            (model / "project.ini").write_bytes(no_picture(rng) + b"\nimage_path=/dev/zero\n")
        case _:
            shutil.rmtree(frames)


def _reconstruction(rng: Rng, views: bool) -> pycolmap.Reconstruction:
    """Return a model of the frames, which move sideways, with their views or without."""
    model, points = pycolmap.Reconstruction(), rng.uniform([-1, -1, 4], [1, 1, 6], (30, 3))
    camera = pycolmap.Camera(
        model="SIMPLE_RADIAL", width=SIZE[0], height=SIZE[1], params=[132, 60, 45, 0.01], camera_id=1
    )
    model.add_camera_with_trivial_rig(camera)
    instants = [(name, float(at)) for at, name in enumerate(NAMES)]
    if views:
        instants += [
            (f"{name}#{end}", at + shift)
            for name, at in instants
            for end, shift in (("open", -0.2), ("close", 0.2))
        ]
    for number, (name, at) in enumerate(instants, 1):
        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(), np.array([0.2 * at, 0, 0]))
        seen = camera.img_from_cam(points + pose.translation)
        image = pycolmap.Image(name=name, keypoints=seen, camera_id=1, image_id=number)
        model.add_image_with_trivial_frame(image, pose)
    for index, point in enumerate(points):
        track = pycolmap.Track()
        for number in range(1, len(instants) + 1):
            track.add_element(number, index)
        model.add_point3D(point, track, np.full(3, 100, np.uint8))
    return model


def _odd_number(path: Path, rng: Rng) -> None:
    """Put odd integers or floats over eight bytes of a binary file, counts at its beginning most often."""
    data = bytearray(path.read_bytes())
    for _ in range(int(rng.integers(1, 4))):
        at = int(rng.choice([0, 8, 12, 16, int(rng.integers(max(len(data) - 8, 1)))]))
        odd = (
            struct.pack("<Q", int(rng.choice(NUMBERS)))
            if rng.random() < 0.5
            else struct.pack("<d", rng.choice([np.nan, np.inf, 1e300, -1]))
        )
        data[at : at + 8] = [odd, b"\xff" * 8, struct.pack("<Q", 1 << 40)][int(rng.integers(3))]
    path.write_bytes(data)


def _odd_word(path: Path, rng: Rng) -> None:
    lines = path.read_text().split("\n")
    for _ in range(int(rng.integers(1, 4))):
        at = int(rng.integers(len(lines)))
        parts = lines[at].split(" ")
        parts[int(rng.integers(len(parts)))] = str(rng.choice(WORDS))
        lines[at] = " ".join(parts)
    path.write_text("\n".join(lines))
