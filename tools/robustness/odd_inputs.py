"""Inputs of every kind, and the oddities of `fuzz`: each returns a call that reads what it made odd."""

import io
import json
import os
import shutil
import sqlite3
import struct
from collections.abc import Callable, Sequence
from contextlib import chdir, closing, redirect_stdout, suppress
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np
import pycolmap
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from blur2view.arrays import AnyArray
from blur2view.cli import commands
from blur2view.errors import OutputError
from blur2view.networks.model_file import shipped_file
from blur2view.output import NOTES
from blur2view.reconstruction.scene import Scene

Rng = np.random.Generator
T = TypeVar("T")
ROOT = Path(__file__).parents[2]
GOOD, SIZE = "good.jpg", (240, 180)
WALK, WALK_SIZE = 11, (320, 240)  # frames, the one in the middle smeared
OUTPUTS = {"-o", "--csv", "--keep", "--extract", "--db"}  # options that name what a call may write
READING = (  # commands that read photographs
    "estimate -o out", "estimate --csv table.csv", "segment -o out", "report -o page.html",
    "to-colmap --db new.db", "triage --csv table.csv --keep keep.txt", "triage --best 1 --extract best",
)  # fmt: skip
LINK, CAMERA = "to-colmap --db project.db --link --sequence frames", "estimate --camera project.db:1 frames"
PLACE, RECOVER = "place linked.db model frames -o placed --fraction 0.4", "recover model frames -o recovered"
SPLAT = "to-transforms views --dialect nerfstudio -o splat/transforms.json"
GSPLAT, NGP = "to-transforms views --dialect gsplat -o scene", "to-transforms views -o ngp/transforms.json"
ODD_NAMES = (
    "tcp:127.0.0.1:9?.mp4", "http:/127.0.0.1:9/clip.mp4", "concat:clip.mp4", "=1+1.jpg", "@good.jpg",
    "-o.jpg", "a\nb.jpg", "#1.jpg", " a.jpg ", "frame_00003.png",
    "\x1b[31m.jpg", "a" * 240 + ".jpg", "%s.jpg", "a#open.jpg", "x.dng", "\udcff.jpg",
)  # fmt: skip
AGAIN = (  # commands that read photographs and are repeated after what they wrote was changed
    "triage --csv table.csv --best 1 --keep keep.txt", "triage --best 2 --extract best",
    "estimate -o out --resume", "segment -o out --resume",
)  # fmt: skip
ODD_ROWS = (  # statements of SQL
    "UPDATE frames SET frame_id = frame_id + 4294967296", "UPDATE frame_data SET frame_id = 4294967307",
    "UPDATE cameras SET params = NULL", "UPDATE keypoints SET data = NULL", "DELETE FROM keypoints",
    "UPDATE keypoints SET cols = 2", "UPDATE keypoints SET data = zeroblob(length(data))",
    "UPDATE images SET name = NULL", "CREATE TRIGGER t AFTER INSERT ON images BEGIN DELETE FROM cameras; END",
    "CREATE VIEW v AS WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c) SELECT x FROM c",
    "ALTER TABLE cameras RENAME TO other; CREATE VIEW cameras AS WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL "
    "SELECT x + 1 FROM c) SELECT x AS camera_id, 2 AS model, 240 AS width, 180 AS height, NULL AS params, "
    "0 AS prior_focal_length FROM c",
)  # fmt: skip
RECOVER_ALL = "recover scene/work/model all -o recovered --jobs 1"
SCENE, FILM = "reconstruct walk -o scene --jobs 1", "reconstruct walk.mp4 -o film --jobs 1"
ODD_OPTIONS = (  # of reconstruct
    "", "--frames 3", "--all-frames", "--no-masks", "--mapper global", "--dialect instant-ngp",
    "--exposure 1/50", "--camera-model OPENCV", "--camera nonsense", "--camera project.db",
)  # fmt: skip
NEW = (  # what stands in a damaged file in place of its own bytes
    b"", b"-1", b"nan", b"9" * 6000, b'"', b"[" * 99_999, b"\0", b"\x1b[2J", b"/dev/zero",
    *(struct.pack(f, number) for f in ("<I", ">I", "<d") for number in (0, 1, 2**31, 2**32 - 1)),
)  # fmt: skip


def drawn(rng: Rng, choices: Sequence[T]) -> T:
    """Return one of several things, each as likely."""
    return choices[int(rng.integers(len(choices)))]


def mutated(data: bytes, rng: Rng) -> bytes:
    """Return data with one to three parts replaced: as many bytes, none, or all that follows."""
    for _ in range(int(rng.integers(1, 4))):
        at, new = int(len(data) ** drawn(rng, (rng.random(), 1.0)) * rng.random()), drawn(rng, NEW)
        data = data[:at] + new + data[drawn(rng, (at + len(new), at, len(data))) :]
    return data


def make_inputs(folder: Path) -> None:
    """Write good inputs of every kind."""
    (folder / "frames").mkdir(parents=True)
    (folder / "model").mkdir()
    options = pycolmap.SyntheticDatasetOptions(num_rigs=1, num_frames_per_rig=3)
    options.camera_width, options.camera_height = SIZE
    options.camera_params = [1.1 * SIZE[0], SIZE[0] / 2, SIZE[1] / 2, 0.01]
    pycolmap.set_random_seed(0)
    with pycolmap.Database.open(folder / "project.db") as database:
        model = pycolmap.synthesize_dataset(options, database)
    model.write_binary(folder / "model")
    shutil.copy(folder / "project.db", folder / "linked.db")
    sample, rng = np.asarray(cv2.imread(str(ROOT / "models/sample.jpg"))), np.random.default_rng(0)
    video = cv2.VideoWriter(str(folder / "clip.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 10, SIZE)
    for name in (GOOD, "other.jpg", *(f"frames/{image.name}" for image in model.images.values())):
        left, top = rng.integers([40, 50], [100, 140])
        part = sample[top : top + SIZE[1], left : left + SIZE[0]]
        cv2.imwrite(str(folder / name), part)
        video.write(part)
    video.release()
    make_walk(folder, sample)
    (folder / "list.txt").write_text(f"# photographs\n{GOOD}\nother.jpg\n")
    shutil.copy(shipped_file("smear.onnx"), folder)
    link = LINK.replace("project.db", "linked.db --no-backup --jobs 1")
    with chdir(folder):
        for words in (link, PLACE.replace("placed", "views"), SCENE):
            if commands.main(words.split()):
                raise SystemExit("whole inputs are refused")


def make_walk(folder: Path, sample: AnyArray) -> None:
    """Write frames of two planes that a camera passes, all and every other one, and these as a video."""
    desk = np.asarray(cv2.imread(str(ROOT / "models/desk.jpg")))
    film = cv2.VideoWriter(str(folder / "walk.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 10, WALK_SIZE)
    (width, height), half = WALK_SIZE, WALK_SIZE[1] // 2
    for name in ("walk", "all"):
        (folder / name).mkdir()
    for k in range(WALK):
        shots = []
        for time in np.linspace(k - 0.4, k + 0.4, 9) if k == WALK // 2 else [k]:
            back = desk[60 : 60 + height, round(60 + 3 * time) :][:, :width].copy()
            back[half:] = sample[150 : 150 + height - half, round(200 + 9 * time) :][:, :width]
            shots.append(back)
        picture = np.mean(shots, axis=0).astype(np.uint8)
        for name in ("all", *["walk"][k % 2 :]):
            cv2.imwrite(str(folder / name / f"f_{k:03d}.png"), picture)
        film.write(picture)
    film.release()


def damaged(folder: Path, rng: Rng) -> list[str]:
    """Damage one input, or put a link in its place; return a command that reads it."""
    ways = [(GOOD, f"{one} {GOOD} other.jpg") for one in READING]
    ways += [("list.txt", f"{READING[1]} @list.txt"), ("clip.mp4", f"{READING[5]} clip.mp4")]
    ways += [("smear.onnx", f"{READING[0]} --model smear.onnx {GOOD}")]
    ways += [("project.db", LINK), ("linked.db", PLACE), ("project.db", CAMERA)]
    ways += [(f"model/{name}.bin", drawn(rng, (PLACE, RECOVER))) for name in ("images", "points3D", "frames")]
    ways += [(f"views/{name}.bin", SPLAT) for name in ("images", "points3D", "cameras")]
    name, words = drawn(rng, ways)
    path, data = folder / name, (folder / name).read_bytes()
    path.unlink()
    if rng.random() < 0.1:
        path.symlink_to(drawn(rng, ("/dev/zero", "/dev/null", "/", "nowhere", path.name)))
    else:
        path.write_bytes(mutated(data, rng))
    return words.split()


def named(folder: Path, rng: Rng) -> list[str]:
    """Give a photograph or a video an odd name."""
    name = drawn(rng, ODD_NAMES)
    (folder / name).parent.mkdir(exist_ok=True, parents=True)
    shutil.copy(folder / ("clip.mp4" if name.endswith(".mp4") else GOOD), folder / name)
    return [*drawn(rng, READING).split(), "--", GOOD, name]


def colliding(folder: Path, rng: Rng) -> list[str]:
    """Let an output be an input, another file of the user's, or a link to one or to a device."""
    command = drawn(rng, (*READING[1:2], *READING[3:6], LINK, PLACE))
    target = drawn(rng, (GOOD, "list.txt", "clip.mp4", "smear.onnx", "model/images.bin"))
    name = drawn(rng, ("link", target))
    if name == "link":
        (folder / name).symlink_to(drawn(rng, (target, "/dev/full", "/dev/null", "nowhere/x", "link")))
    words = command.split()
    words[drawn(rng, [at for at, word in enumerate(words) if word in OUTPUTS]) + 1] = name
    return [*words, GOOD, "other.jpg"] if command in READING else words


def odd_rows(folder: Path, rng: Rng) -> list[str]:
    """Write rows into a project that no program writes; return a command that reads it."""
    name, words = drawn(rng, [("project.db", LINK), ("project.db", CAMERA), ("linked.db", PLACE)])
    with closing(sqlite3.connect(folder / name)) as database:
        database.execute("PRAGMA foreign_keys = OFF")
        statement = drawn(rng, ODD_ROWS)
        with suppress(sqlite3.Error):  # of a table that this kind of project lacks
            database.executescript(statement)
    return words.split()


def odd_file(folder: Path, rng: Rng) -> list[str]:
    """Put a file that is valid and extreme in place of a photograph or a video."""
    kind = drawn(rng, ("sparse video", "long comment", "one bit", "narrow"))
    if kind == "sparse video":
        with (folder / "clip.mp4").open("ab") as video:
            video.truncate(1 << 40)
        return [*READING[5].split(), "--every", "5", "clip.mp4"]
    pixels: Image.Image = Image.open(folder / GOOD)
    text = PngInfo()
    if kind == "long comment":
        text.add_text("Comment", "x" * 2_000_000, zip=bool(rng.random() < 0.5))
    pixels = pixels.convert("1") if kind == "one bit" else pixels
    pixels = pixels.resize((16, 20_000)) if kind == "narrow" else pixels
    pixels.save(folder / "odd.png", pnginfo=text)
    return [*drawn(rng, READING).split(), GOOD, "odd.png"]


def again(folder: Path, rng: Rng) -> list[str]:
    """Repeat a call after what it wrote was changed: a table, a list, a folder of extracted pictures."""
    words = [*drawn(rng, AGAIN).split(), GOOD, "other.jpg"]
    before = set(folder.rglob("*"))
    with chdir(folder), redirect_stdout(io.StringIO()):
        if commands.main([*words, "--jobs", "1"]):
            raise SystemExit("whole inputs are refused")
    written = sorted(path for path in set(folder.rglob("*")) - before if path.is_file())
    path = drawn(rng, [path for path in written if path.name != NOTES])
    whole = path.read_bytes()
    changed = whole
    while changed == whole:
        changed = mutated(whole, rng)
    path.write_bytes(changed)
    return words


def little_memory(folder: Path, rng: Rng) -> list[str]:
    """Return a command that gets an address space of some hundreds of megabytes (`try_case`)."""
    return drawn(rng, (*(f"{one} {GOOD}" for one in READING), PLACE, RECOVER)).split()


def cut_text(folder: Path, rng: Rng) -> None:
    """Write the views' model as text, one file of it cut between two lines."""
    model = pycolmap.Reconstruction(folder / "views")
    shutil.rmtree(folder / "views")
    (folder / "views").mkdir()
    model.write_text(folder / "views")
    path = folder / "views" / f"{drawn(rng, ('cameras', 'images', 'points3D', 'frames', 'rigs'))}.txt"
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join(lines[: int(rng.integers(len(lines)))]))


def odd_camera(folder: Path, rng: Rng) -> None:
    """Give the camera of the views' model a size or focal length that no camera has."""
    model = pycolmap.Reconstruction(folder / "views")
    for camera in model.cameras.values():
        name = drawn(rng, ("width", "height", "params"))
        wrong = drawn(rng, (0.0, -1.0, 1e-300, 1e29))
        setattr(camera, name, [wrong, *camera.params[1:]] if name == "params" else max(0, int(wrong > 1) * 7))
    model.write_binary(folder / "views")


def refined(folder: Path, rng: Rng) -> None:
    """Write what to-transforms and place write, and change it."""
    for words in (SPLAT, GSPLAT, PLACE):
        with chdir(folder), redirect_stdout(io.StringIO()):
            commands.main(words.split())
    ours = "splat/transforms.json", "splat/sparse_pc.ply", "scene/sparse/0/images.bin", "placed/points3D.bin"
    for name in ours:
        (folder / name).write_bytes((folder / name).read_bytes().replace(b"\0\0", b"\0\1", 1) + b" ")


def other_size(folder: Path, rng: Rng) -> None:
    """Resize photographs, evenly or not."""
    width, height = drawn(rng, ((120, 90), (121, 90), (240, 179), (90, 120), (1, 1)))
    for path in (folder / "frames").iterdir():
        if rng.random() < 0.7:
            Image.open(path).resize((width, height)).save(path)


def odd_model(folder: Path, rng: Rng) -> list[str]:
    """Make a model, its photographs or what was written from it odd; return a command that reads it."""
    drawn(rng, (cut_text, odd_camera, refined, other_size))(folder, rng)
    return drawn(rng, (SPLAT, GSPLAT, NGP, PLACE)).split()


def odd_frames(folder: Path, rng: Rng) -> list[str]:
    """Make the frames of a scene odd: damaged, few, of other sizes or names, dark, beside other files."""
    frames = sorted((folder / "walk").iterdir())
    path = drawn(rng, frames)
    match drawn(rng, ("damaged", "few", "sizes", "name", "dark", "turned", "beside", "deep", "same")):
        case "damaged":
            path.write_bytes(mutated(path.read_bytes(), rng))
        case "few":
            for frame in frames[int(rng.integers(4)) :]:
                frame.unlink()
        case "sizes":
            for frame in frames if rng.random() < 0.5 else [path]:
                side = int(rng.integers(15, 400))
                Image.open(frame).resize((side, 241)).save(frame)
        case "name":
            name = os.fsencode(
                drawn(rng, [name for name in ODD_NAMES if "/" not in name and "mp4" not in name])
            )
            path.rename(path.parent / os.fsdecode(name.replace(b".jpg", b".png").replace(b".dng", b".png")))
        case "dark":
            for frame in frames:
                Image.new("L", WALK_SIZE, int(rng.integers(256))).save(frame)
        case "turned":
            exif = Image.Exif()
            exif[0x0112] = int(rng.integers(10))
            for frame in frames if rng.random() < 0.5 else [path]:
                Image.open(frame).save(frame.with_suffix(".jpg"), exif=exif)
                frame.unlink()
        case "beside":
            for other in ("notes.txt", "clip.mp4", ".hidden.png"):
                shutil.copy(folder / drawn(rng, ("list.txt", "clip.mp4", GOOD)), folder / "walk" / other)
        case "deep":
            (folder / "walk" / "a b").mkdir()
            for frame in frames[::2]:
                frame.rename(folder / "walk" / "a b" / frame.name)
        case "same":
            for frame in frames:
                shutil.copy(path, folder / "same.png")
                shutil.copy(folder / "same.png", frame)
    return [*SCENE.replace("scene", "anew").split(), *drawn(rng, ODD_OPTIONS).split()]


def odd_scene(folder: Path, rng: Rng) -> list[str]:
    """Damage or remove a file of a scene, or name another output; return the call that goes on."""
    where = drawn(rng, ("scene", "scene", "scene", "film", "mine"))
    if where == "mine":
        (folder / "mine").mkdir()
        shutil.copy(folder / GOOD, folder / "mine")
        return SCENE.replace("scene", drawn(rng, ("mine", GOOD, "walk", "walk/scene", "/dev/null"))).split()
    if where == "film":
        path = folder / "walk.mp4"
        path.write_bytes(mutated(path.read_bytes(), rng))
        return [*FILM.split(), *drawn(rng, ODD_OPTIONS).split()]
    scene = folder / "scene"
    every = sorted(path for path in scene.rglob("*") if path.is_file())
    for path in (drawn(rng, every) for _ in range(int(rng.integers(1, 4)))):
        if rng.random() < 0.4:
            path.unlink(missing_ok=True)
        elif path.exists():
            path.write_bytes(mutated(path.read_bytes(), rng))
    state = scene / "reconstruction.json"
    if rng.random() < 0.5 and state.exists() and b'"steps"' in state.read_bytes():
        with suppress(ValueError, LookupError, OutputError):  # as if it had been ended after some steps
            known = Scene(scene, json.loads(state.read_bytes())["call"])
            for name in list(known.steps)[int(rng.integers(len(known.steps))) :]:
                del known.steps[name]
            known.write()
    return SCENE.split()


def recovering(folder: Path, rng: Rng) -> list[str]:
    """Damage what a video's missing frame is recovered by; return the call."""
    words = RECOVER_ALL + drawn(
        rng, ("", " --db scene/database.db", " --views --refine", " --tracks scene/database.db")
    )
    name = drawn(rng, ("scene/database.db", "scene/work/model", "all", "recovered"))
    path = folder / name
    if name == "recovered":
        path.mkdir()
        (path / "recovering.jsonl").write_bytes(
            mutated(b'{"generator": "blur2view recover", "name": 1}\n' * 9, rng)
        )
        return words.split()
    if path.is_dir():
        path = drawn(rng, sorted(path.iterdir()))
    path.write_bytes(mutated(path.read_bytes(), rng))
    return words.split()


def library(folder: Path, rng: Rng) -> list[str]:
    """Return what calls a function of the library with odd arguments, drawn in that process."""
    return [str(int(rng.integers(2**31)))]


LITTLE = "little memory"
KINDS: dict[str, Callable[[Path, Rng], list[str]]] = {
    "damaged": damaged, "oddly named": named, "output is an input": colliding, "odd rows": odd_rows,
    "odd file": odd_file, "odd model": odd_model, "changed since": again, LITTLE: little_memory,
    "odd frames": odd_frames, "odd scene": odd_scene, "recovering": recovering, "library": library,
}  # fmt: skip
