"""Inputs of every kind with nothing wrong: photographs, videos, a list, a network, projects, models."""

import os
import shutil
import sqlite3
import sys
from contextlib import closing
from pathlib import Path
from subprocess import DEVNULL, PIPE, Popen
from typing import Any

import cv2
import numpy as np
import pillow_heif
import pycolmap
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from blur2view.networks.model_file import shipped_file
from tools.robustness.mutations import Rng

ROOT = Path(__file__).parents[2]
PROGRAM = (sys.executable, "-m", "blur2view")
TRAPS = "traps"  # beside the folder of a call, see `set_traps`
TRAPPED = (
    "gs", "gswin64c", "djpeg", "xv", "convert", "magick", "identify", "ffmpeg", "ffprobe", "dcraw",
    "exiftool", "colmap", "sh", "bash",
)  # fmt: skip
"""Programs that libraries for pictures, videos and models are known to call, and shells: none may start."""
GOOD, OTHER, SIZE = "good.jpg", "other.jpg", (240, 180)
FORMATS = {  # that Pillow writes, and modes of each
    "JPEG": "RGB L CMYK", "PNG": "RGB RGBA L LA P 1 I;16", "TIFF": "RGB RGBA L CMYK 1 I;16 F I",
    "WEBP": "RGB RGBA", "BMP": "RGB L P", "HEIF": "RGB", "GIF": "P", "PPM": "RGB L", "TGA": "RGB RGBA",
    "ICO": "RGBA", "JPEG2000": "RGB L", "PCX": "RGB", "EPS": "RGB L CMYK",
}  # fmt: skip
ODD_SIZES = ((1, 1), (15, 400), (16, 16), (17, 900), (2000, 16), (64, 65), (31, 33))


def set_traps(folder: Path) -> None:
    """Write programs of these names into a new folder; one that is started writes its name to "ran" there."""
    folder.mkdir()
    for name in TRAPPED:
        program = folder / name
        program.write_text(f"#!{sys.executable}\nopen({str(folder / 'ran')!r}, 'a').write('{name}\\n')\n")
        program.chmod(0o755)


def start(folder: Path, words: list[str], **streams: Any) -> Popen[Any]:
    """Start a call in a folder, in a group of processes of its own, the traps before all other programs."""
    path = f"{folder.parent / TRAPS}{os.pathsep}{os.environ['PATH']}"
    environment = os.environ | {"PYTHONPATH": str(ROOT), "HOME": f"{folder}-home", "PATH": path}
    streams = {"stdout": DEVNULL, "stderr": PIPE} | streams
    return Popen([*PROGRAM, *words], cwd=folder, env=environment, start_new_session=True, **streams)


def blurred(rng: Rng, size: tuple[int, int] = SIZE) -> Image.Image:
    """Return a part of the sample, RGB, in which the camera turns."""
    left, top = (int(corner) for corner in rng.integers([40, 50], [100, 140]))
    with Image.open(ROOT / "models/sample.jpg") as sample:
        return sample.crop((left, top, left + SIZE[0], top + SIZE[1])).resize(size)


def make_project(folder: Path, seed: int) -> list[str]:
    """Write "project.db", "model/" and "frames/" of three frames of a moving camera; return their names."""
    options = pycolmap.SyntheticDatasetOptions(num_rigs=1, num_frames_per_rig=3)
    options.camera_width, options.camera_height = SIZE
    options.camera_params = [1.1 * SIZE[0], SIZE[0] / 2, SIZE[1] / 2, 0.01]
    pycolmap.set_random_seed(seed)
    with pycolmap.Database.open(folder / "project.db") as database:
        model = pycolmap.synthesize_dataset(options, database)
    for name in ("model", "frames"):
        (folder / name).mkdir()
    model.write_binary(folder / "model")
    names = sorted(f"frames/{image.name}" for image in model.images.values())
    for number, name in enumerate(names):
        blurred(np.random.default_rng([seed, number])).save(folder / name)
    return names


def make_corpus(folder: Path, seed: int) -> None:
    """Write all inputs into a new folder; "pictures/" holds photographs of every format."""
    rng = np.random.default_rng(seed)
    for name in ("pictures", "model_text", "views_text"):
        (folder / name).mkdir(parents=True)
    names = make_project(folder, seed)
    for name in (GOOD, OTHER):
        blurred(rng).save(folder / name, quality=95)
    _write_pictures(folder / "pictures", rng)
    for name, codec in (("clip.mp4", "mp4v"), ("clip.avi", "MJPG")):
        video = cv2.VideoWriter(str(folder / name), cv2.VideoWriter.fourcc(*codec), 10, SIZE)
        for _ in range(8):
            video.write(np.asarray(blurred(rng))[..., ::-1])
        video.release()
    (folder / "list.txt").write_text("\n".join(["# photographs", "", GOOD, OTHER, names[0], ""]))
    for name in ("journal.db", "linked.db"):
        shutil.copy(folder / "project.db", folder / name)
    with closing(sqlite3.connect(folder / "journal.db")) as database:
        database.execute("PRAGMA journal_mode = DELETE")  # pycolmap turns on write-ahead logs
    place = "place linked.db model frames --fraction 0.4 -o views"
    for words in ("to-colmap --link --no-backup --db linked.db frames", place):
        call = start(folder, words.split())
        if (said := call.communicate()[1]) or call.returncode:
            raise SystemExit(f"{words}: fails with whole inputs: {said}")
    for name in ("model", "views"):
        pycolmap.Reconstruction(folder / name).write_text(folder / f"{name}_text")
    shutil.copy(shipped_file("smear.onnx"), folder)
    (folder / ".linked.db.manifest.jsonl").unlink()


def _write_pictures(folder: Path, rng: Rng) -> None:
    """Write photographs of all formats and modes, of odd sizes, with EXIF, and two that unfold."""
    pillow_heif.register_heif_opener()
    for kind, modes in FORMATS.items():
        for mode in modes.split():
            picture = blurred(rng).convert("L" if mode in ("I;16", "I", "F") else mode)
            if wide := {"I;16": np.uint16, "I": np.int32, "F": np.float32}.get(mode):
                picture = Image.fromarray(np.asarray(picture).astype(wide) * wide(200))
            picture.save(folder / f"{kind}-{mode.replace(';', '')}", kind)
    for width, height in ODD_SIZES:
        blurred(rng, (width, height)).save(folder / f"{width}x{height}", "PNG")
    exif = Image.Exif()
    exif[0x0112] = 6  # orientation; focal lengths, their unit, exposure time
    exif.get_ifd(0x8769).update({0x920A: 8.0, 0xA405: 28, 0xA20E: 900.0, 0xA210: 2, 0x829A: 0.04})
    blurred(rng).save(folder / "exif", "JPEG", exif=exif)
    text = PngInfo()
    text.add_text("comment", "0" * 10**7, zip=True)
    blurred(rng).save(folder / "text", "PNG", pnginfo=text)
    Image.new("1", (13000, 13000)).save(folder / "bomb", "PNG")  # 21 KB that unfold to 500 MB of colours
