"""COLMAP's features, matches and model of the chosen frames, made in a folder and repeatable."""

import shutil
import sqlite3
from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

from blur2view.colmap.mapping import SEED, SOLVER_SECONDS, blurred_options
from blur2view.colmap.project import connect
from blur2view.errors import DatabaseError, RunError
from blur2view.processes import follow_parent, not_started, spawn_context

EXHAUSTIVE = 150  # frames up to which all pairs are matched
# Where COLMAP's 16 degrees and 1.2 make too small a model. Of the middle 20 frames of RedKitchen, of a focal
# length of 0.85, they register 4 of an unknown camera, these 20; of a known one none and 20.
NEAR_ANGLE_DEG = 4.0  # at which a point of the first pair is seen
FOCAL_SHARE = 0.85  # of the longer side: the focal length of an unknown camera, at first
LOOP_STEP = 10  # one in so many frames is matched with all others of these, which finds loops
MIN_FEATURES = 100  # in the median frame; fewer are too little texture
STILL_WAY = 0.02  # of the picture's side: a camera whose picture moves less all the while stood still
PANORAMIC = (4, 5, 6)  # COLMAP's configurations of planes, rotations, and either


def in_process(call: Callable[..., Any], *given: Any, **options: Any) -> Any:
    """Return what a function returns that a process of its own runs: Ctrl-C, which pycolmap ignores, ends it.

    RunError if the process dies, or cannot be started.
    """
    import pycolmap

    context = spawn_context()
    answers, answer = context.Pipe(duplex=False)
    start = context.Event(), answer, pycolmap.logging.minloglevel, call, given, options
    process = context.Process(target=_answer, args=start)
    try:
        process.start()
    except OSError as error:
        raise not_started(error) from None
    answer.close()
    try:
        result = answers.recv()
    except EOFError:
        remedy = "choose fewer frames with --frames"
        raise RunError(f"COLMAP's process died, perhaps because of too little memory; {remedy}") from None
    finally:
        process.kill()
        process.join()
    if isinstance(result, Exception):
        raise result
    return result


def _answer(
    stop: Any, answer: Any, log_level: int, call: Callable[..., Any], given: Any, options: Any
) -> None:
    """Send what a function returns or raises."""
    import pycolmap

    follow_parent(stop)
    pycolmap.logging.minloglevel = log_level
    try:
        answer.send(call(*given, **options))
    except Exception as error:  # of any type: it is raised where the call was asked for
        answer.send(error)


def match(
    database: Path, images: Path, names: Sequence[str], *, camera: tuple[str, str], blurred: bool
) -> None:
    """Write features and verified matches of images; a database that was begun is gone on with.

    ``camera`` is COLMAP's model and parameters, empty if unknown. ``blurred`` frames are read as
    `blurred_options` says, and all matched.
    """
    in_process(_match, database, images, names, camera, blurred)


def _match(
    database: Path, images: Path, names: Sequence[str], camera: tuple[str, str], blurred: bool
) -> None:
    import pycolmap

    database.parent.mkdir(parents=True, exist_ok=True)
    reader = pycolmap.ImageReaderOptions(camera_model=camera[0], camera_params=camera[1])
    if len(_rows(database, "SELECT name FROM images")) != len(names):
        database.unlink(missing_ok=True)
        pycolmap.Database.open(database).close()
        pycolmap.import_images(
            database, images, pycolmap.CameraMode.SINGLE, list(names), reader
        )  # in order, so that ids are the same
    features, matching = pycolmap.FeatureExtractionOptions(), pycolmap.FeatureMatchingOptions()
    if blurred:
        features, matching = blurred_options()
    features.use_gpu = matching.use_gpu = False
    verifying = pycolmap.TwoViewGeometryOptions()
    verifying.ransac.random_seed = SEED
    common: dict[str, Any] = {"matching_options": matching, "verification_options": verifying}
    pycolmap.extract_features(
        database,
        images,
        image_names=list(names),
        camera_mode=pycolmap.CameraMode.SINGLE,
        reader_options=reader,
        extraction_options=features,
    )
    if blurred or len(names) <= EXHAUSTIVE:
        pycolmap.match_exhaustive(database, **common)
        return
    pycolmap.match_sequential(database, **common)
    every = list(names)[::LOOP_STEP]
    pairs = database.with_suffix(".pairs.txt")
    pairs.write_text("".join(f"{a} {b}\n" for k, a in enumerate(every) for b in every[k + 1 :]))
    listed = pycolmap.ImportedPairingOptions(match_list_path=pairs)
    pycolmap.match_image_pairs(database, pairing_options=listed, **common)
    pairs.unlink()


def mapped(
    database: Path, images: Path, folder: Path, *, mapper: str, camera_known: bool, again: bool = False
) -> list[Any]:
    """Return the models of a database, the one with most images first; none if no pair is good enough.

    Tried ``again``, the incremental mapper begins with a nearer pair, and a shorter focal length if it is
    unknown, which the database has then.
    """
    import pycolmap

    count = in_process(_map, database, images, folder, mapper, camera_known, again)
    models = [pycolmap.Reconstruction(folder / str(number)) for number in range(count)]
    return sorted(models, key=lambda model: -model.num_reg_images())


def _map(database: Path, images: Path, folder: Path, mapper: str, camera_known: bool, again: bool) -> int:
    """Write models into numbered folders; return how many."""
    import pycolmap

    folder.mkdir(parents=True, exist_ok=True)
    if mapper == "global":
        at_once = pycolmap.GlobalPipelineOptions(random_seed=SEED, num_threads=1)
        solver = at_once.mapper.bundle_adjustment.ceres.solver_options
        solver.max_solver_time_in_seconds = SOLVER_SECONDS
        models = pycolmap.global_mapping(database, images, folder, at_once)
    else:
        options = pycolmap.IncrementalPipelineOptions(random_seed=SEED, num_threads=1, min_model_size=3)
        if again:
            options.mapper.init_min_tri_angle = NEAR_ANGLE_DEG
            _guess_focal_length(database)
        if camera_known:
            options.ba_refine_focal_length = options.ba_refine_extra_params = False
        models = pycolmap.incremental_mapping(database, images, folder, options)
    for number, model in models.items():
        (folder / str(number)).mkdir(exist_ok=True)
        model.write(folder / str(number))
    return len(models)


def _guess_focal_length(database: Path) -> None:
    """Write `FOCAL_SHARE` for cameras whose focal length is a guess."""
    import pycolmap

    with pycolmap.Database.open(database) as opened:
        for camera in opened.read_all_cameras():
            if not camera.has_prior_focal_length:
                params = np.array(camera.params)
                params[list(camera.focal_length_idxs())] = FOCAL_SHARE * max(camera.width, camera.height)
                camera.params = params.tolist()
                opened.update_camera(camera)


def copied(database: Path, copy: Path) -> Path:
    """Return a copy of a database, without the logs of a call that was killed."""
    for log in ("-journal", "-wal", "-shm"):
        Path(f"{copy}{log}").unlink(missing_ok=True)
    return Path(shutil.copyfile(database, copy))


def why_no_model(database: Path, way: float) -> str:
    """Return why COLMAP made no model of a database, with a remedy; ``way`` is how far the picture moved."""
    features = [count for (count,) in _rows(database, "SELECT rows FROM keypoints")]
    if not features or np.median(features) < MIN_FEATURES:
        return "half of the frames have fewer than 100 features; use more light, or film things with texture"
    if way < STILL_WAY:
        return "the camera stood still; move it sideways past the scene"
    pairs = [config for (config,) in _rows(database, "SELECT config FROM two_view_geometries WHERE rows > 0")]
    if not pairs:
        return "no two frames show the same things sharply; move more slowly, or raise --frames"
    if np.mean(np.isin(pairs, PANORAMIC)) > 0.5:
        return "the camera only turned, or saw a single plane; move it sideways past the scene"
    return "no two frames were taken far enough apart; move the camera sideways past the scene"


def _rows(database: Path, sql: str) -> list[tuple[Any, ...]]:
    """Return rows of a database; none if there is none or it has no such table."""
    if not database.is_file():
        return []
    try:
        with closing(connect(database, "mode=ro")) as opened:
            return opened.execute(sql).fetchall()
    except sqlite3.OperationalError:
        return []
    except sqlite3.DatabaseError as error:
        raise DatabaseError(
            f"{database}: is damaged ({error}); remove it, and run the command again"
        ) from None
