r"""Reconstruct videos of blurred frames with COLMAP, without and with the views that their blur gives.

    python -m tools.reconstruction.sequence render/sequence --seed 1 --photos KODAK
    python -m tools.reconstruction.sfm_experiment --sequence render/sequence \
        --out tools/results/sfm_experiment.md --redkitchen ../shared/data/redkitchen_sequence

Each video goes through SIFT, sequential matching and incremental mapping with COLMAP's defaults and the true
intrinsics. Then ``blur2view to-colmap --link --sequence`` adds the views. `blur2view.colmap.placement` places
them in that model; the mapper adds them to it under ``mapper_options(linked=True, keep_photographs=True)``.
The report has what was registered, errors against the true poses after one similarity, and the motion during
every exposure: of the models' virtual views, and of the single photographs as they were estimated.
"""

from __future__ import annotations

import contextlib
import io
import json
import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from blur2view.camera.colmap_camera import to_colmap
from blur2view.cli.commands import main as blur2view_main
from blur2view.colmap.mapping import mapper_options
from blur2view.colmap.placement import place_views
from blur2view.errors import Blur2ViewError
from blur2view.exposure.views import CLOSE, OPEN
from blur2view.geometry.rotation import rotation_vector
from blur2view.networks.smear_network import SmearNetwork
from tools.arguments import existing, parser_of, target
from tools.reconstruction.alignment import Motion
from tools.reconstruction.recording import Recording, redkitchen_recording, rendered_recording
from tools.reconstruction.sfm_report import Result, markdown, read_model

OVERLAP = 6
"""Frames ahead that a frame is matched with."""
HEADER = "Of ``python -m tools.reconstruction.sfm_experiment``; see there what was done.\n"
INITIAL_ANGLE_DEG = 4.0
"""To begin a model with: in a second of hand-held video nothing is seen at COLMAP's 16 degrees."""


def fresh_database(path: Path, recording: Recording) -> None:
    """Write features and verified matches of a recording, with its true intrinsics, by COLMAP's means."""
    import pycolmap

    K = recording.K
    reader = pycolmap.ImageReaderOptions()
    reader.camera_model = "PINHOLE"
    reader.camera_params = ",".join(map(str, [K[0, 0], K[1, 1], *to_colmap(K[:2, 2])]))
    extraction, matching = pycolmap.FeatureExtractionOptions(), pycolmap.FeatureMatchingOptions()
    extraction.num_threads = matching.num_threads = 1
    pairing = pycolmap.SequentialPairingOptions()
    pairing.overlap, pairing.quadratic_overlap = OVERLAP, False
    verification = pycolmap.TwoViewGeometryOptions()
    verification.ransac.random_seed = 0
    pycolmap.extract_features(
        path,
        recording.paths[0].parent,
        [image.name for image in recording.paths],
        pycolmap.CameraMode.SINGLE,
        reader,
        extraction,
    )
    pycolmap.match_sequential(path, matching, pairing, verification)


def run_mapper(
    database: Path, images: Path, options: Any, out: Path, start: Path | None = None
) -> Path | None:
    """Return the largest model of incremental mapping; None if COLMAP builds none.

    Returns
    -------
    Path or None
        A numbered folder below ``out``; where a model on disk, ``start``, was continued, ``out`` itself.
    """
    import pycolmap

    options.num_threads = 1
    out.mkdir()
    models = pycolmap.incremental_mapping(database, images, out, options, str(start or ""))
    if not models or start is not None:
        return out if models else None
    return out / str(max(models, key=lambda key: int(models[key].num_reg_images())))


def plain_options() -> Any:
    """Return COLMAP's own options but for known intrinsics, a seed and the angle to begin with."""
    import pycolmap

    options = pycolmap.IncrementalPipelineOptions()
    options.ba_refine_focal_length = options.ba_refine_extra_params = False
    options.mapper.abs_pose_refine_focal_length = options.mapper.abs_pose_refine_extra_params = False
    options.random_seed = 0
    options.mapper.init_min_tri_angle = INITIAL_ANGLE_DEG
    return options


def link(database: Path, recording: Recording, model: Path | None) -> list[dict[str, Any]]:
    """Run ``blur2view to-colmap --link --sequence`` on every frame; return what its JSON says of each.

    Blur2ViewError if the command fails.
    """
    arguments = ["to-colmap", "--db", database, "--link", "--no-backup", "--sequence", "--json"]
    arguments += ["--camera", f"{database}:1", *recording.paths]
    arguments += [] if model is None else ["--model", model]
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        code = blur2view_main([str(argument) for argument in arguments])
    if code != 0:
        raise Blur2ViewError(f"{database}: to-colmap ended with {code}; see above")
    photographs: list[dict[str, Any]] = json.loads(said.getvalue())["photographs"]
    return photographs


def estimated_motion(database: Path, names: Sequence[str]) -> Motion:
    """Return the motion of every photograph's open and close views in the database."""
    import pycolmap

    rotations, translations = np.full((2, len(names), 3), np.nan)
    with pycolmap.Database.open(database) as opened:
        ids = {image.name: image.image_id for image in opened.read_all_images()}
        for k, name in enumerate(names):
            if name + OPEN not in ids:
                continue
            pose = opened.read_two_view_geometry(ids[name + OPEN], ids[name + CLOSE]).cam2_from_cam1
            if pose is not None:
                rotations[k] = rotation_vector(pose.rotation.matrix())
                translations[k] = pose.translation
    return Motion(rotations=rotations, translations=translations)


def place(database: Path, model: Path, recording: Recording, out: Path) -> Path:
    """Place the views beside the photographs of a model; return the folder of the model with both."""
    out.mkdir()
    place_views(database, model, [path.name for path in recording.paths]).model.write(out)
    return out


def experiment(recording: Recording, model: Path | None) -> Result:
    """Return the reconstructions of a recording without and with views."""
    images = recording.paths[0].parent
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        database, linked = folder / "plain.db", folder / "linked.db"
        fresh_database(database, recording)
        without = run_mapper(database, images, plain_options(), folder / "without")
        shutil.copy(database, linked)
        photographs = link(linked, recording, model)
        options = mapper_options(linked=True, keep_photographs=without is not None, refine_intrinsics=False)
        options.mapper.init_min_tri_angle = INITIAL_ANGLE_DEG
        placed = None if without is None else place(linked, without, recording, folder / "placed")
        mapped = run_mapper(linked, images, options, folder / "mapped", start=without)
        folders = {"without views": without, "views placed": placed, "views mapped": mapped}
        return Result(
            recording=recording,
            models={name: read_model(where) for name, where in folders.items()},
            estimated=estimated_motion(linked, [path.name for path in recording.paths]),
            time_known=sum(bool(one["time_known"]) for one in photographs),
            model_id=f"network {SmearNetwork(model).info.model_id}",
        )


def main() -> None:
    """Command line."""
    parser = parser_of(__doc__)
    parser.add_argument("--sequence", type=existing, help="folder of tools.reconstruction.sequence")
    parser.add_argument("--redkitchen", type=existing, help="folder of redkitchen_sequence")
    parser.add_argument("--frames", type=int, help="only so many frames of each")
    parser.add_argument("--model", type=existing, help="ONNX file; the shipped one by default")
    parser.add_argument("--out", type=target, help="Markdown file to write")
    arguments = parser.parse_args()
    recordings = [] if arguments.sequence is None else [rendered_recording(arguments.sequence)]
    recordings += [] if arguments.redkitchen is None else [redkitchen_recording(arguments.redkitchen)]
    text = HEADER
    for recording in recordings:
        text += "\n" + markdown(experiment(recording.first(arguments.frames), arguments.model))
    print(text)
    if arguments.out is not None:
        arguments.out.write_text(text)


if __name__ == "__main__":
    main()
