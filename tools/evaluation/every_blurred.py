"""What ``blur2view recover --tracks`` gains where every frame is blurred, on frames whose poses are known.

``python -m tools.evaluation.every_blurred SEQUENCE WORK --out tools/results/every_blurred.md`` blurs the
frames of a sequence that has a ``model``. The page says how, and what its columns mean.
"""

from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pycolmap

from blur2view.cli import commands
from blur2view.colmap.mapping import blurred_options
from blur2view.geometry.pose import rotation_vector
from blur2view.images.image import read_picture
from blur2view.networks.smear_network import SmearNetwork
from tools.command import Existing, Target, publish, run, table
from tools.evaluation.placed import Poses, extracted, poses_of
from tools.evaluation.recovered import averaged

SEEDS = range(3)  # of COLMAP's mapper; it may begin with a wrong pair: seed 0 joins 3 of 11 frames of 36 px
WIDER = [1, 2, 3]  # frames averaged before and after
LEAD = """\
Every frame is the mean of 3, 5 or 7 consecutive frames of a sequence in linear light, and no two of them
share a frame. COLMAP maps them with known intrinsics and exhaustive matching, once with its default options
and once at its best (`blur2view.blurred_options()`). From the second model `blur2view recover --tracks`
writes *matches of patches* in addition to those of SIFT, and COLMAP maps anew from both; *and recovered*
means that `blur2view recover` then registers the frames that this model lacks. COLMAP maps with three seeds,
because a mapper may begin with a wrong pair, and the model with the most frames counts. A cell has the number
of registered frames, and the median error in degrees of the rotation from each of them to the next."""
HEAD = "smears, px | frames | COLMAP's defaults | COLMAP at its best | matches of patches | and recovered"


def blur(source: Path, folder: Path, wider: int) -> Poses:
    """Write means of 2 ``wider`` + 1 frames, and return the true poses."""
    true = poses_of(pycolmap.Reconstruction(source / "model"))
    names, found = sorted(true), Poses()
    folder.mkdir(parents=True)
    for k in range(wider, len(names) - wider, 2 * wider + 2):
        name = f"f_{len(found):03d}.png"
        mean = averaged([source / one for one in names[k - wider : k + wider + 1]])
        cv2.imwrite(str(folder / name), mean)
        found[name] = true[names[k]]
    return found


def mapped(database: Path, frames: Path, folder: Path) -> Path:
    """Return the folder of the model with most frames, then points, that COLMAP makes; its cameras stay."""
    options = pycolmap.IncrementalPipelineOptions()
    options.ba_refine_focal_length = options.ba_refine_extra_params = False
    options.min_model_size, options.num_threads = 3, 1
    sizes = {folder: (0, 0)}
    for options.random_seed in SEEDS:
        seed = folder / str(options.random_seed)
        seed.mkdir(parents=True)
        for number, model in pycolmap.incremental_mapping(database, frames, seed, options).items():
            sizes[seed / str(number)] = (model.num_reg_images(), model.num_points3D())
    return max(sizes, key=lambda path: sizes[path])


def measured(folder: Path, true: Poses) -> str:
    """Return how many frames a model has, if there is one, and by how many degrees their turns err."""
    if not (folder / "images.bin").exists():
        return "none"
    poses = poses_of(pycolmap.Reconstruction(folder))
    names = [name for name in true if name in poses]
    turns = [[one[b][:, :3] @ one[a][:, :3].T for a, b in pairwise(names)] for one in (poses, true)]
    off = [np.linalg.norm(rotation_vector(R @ known.T)) for R, known in zip(*turns, strict=True)]
    return f"{len(names)}: {np.degrees(np.median(off)):.2f}"


def recovered(model: Path, frames: Path, out: Path, *options: str | Path) -> Path:
    """Return the folder that ``blur2view recover`` writes; SystemExit if it fails."""
    if commands.main([str(word) for word in ("recover", model, frames, "-o", out, *options)]):
        raise SystemExit(f"{model}: nothing is recovered")
    return out


def row(sequence: Path, work: Path, wider: int, network: SmearNetwork) -> tuple[Any, ...]:
    """Return the row of a table, of frames that are each the mean of 2 ``wider`` + 1."""
    frames = work / "frames"
    true = blur(sequence, frames, wider)
    smears = [network.predict(read_picture(frames / name).pixels).smears().length_px for name in true]
    camera = next(iter(pycolmap.Reconstruction(sequence / "model").cameras.values()))
    options = {
        "defaults": (pycolmap.FeatureExtractionOptions(), pycolmap.FeatureMatchingOptions()),
        "best": blurred_options(),
    }
    for features, matching in options.values():
        features.use_gpu, features.num_threads, matching.num_threads = False, 1, 1
    defaults, best = (extracted(work / f"{key}.db", frames, camera, *one) for key, one in options.items())
    models = [mapped(defaults, frames, work / "defaults"), mapped(best, frames, work / "best")]
    tracks = recovered(models[-1], frames, work / "tracks", "--tracks", best) / "tracks.db"
    models.append(mapped(tracks, frames, work / "anew"))
    models.append(recovered(models[-1], frames, work / "recovered"))
    smear_px = np.median([np.median(one) for one in smears])
    return (f"{smear_px:.0f}", len(true), *(measured(one, true) for one in models))


def main(sequence: Existing, work: Path, *, wider: list[int] = WIDER, out: Target | None = None) -> None:
    """Measure a sequence whose model has all frames, in new folders of ``work``."""
    network = SmearNetwork()
    rows = [row(sequence, work / f"wider_{one}", one, network) for one in wider]
    publish(out, "# Videos of which every frame is blurred", LEAD, table(HEAD, rows))


if __name__ == "__main__":
    run(main)
