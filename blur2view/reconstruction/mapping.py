"""COLMAP's features, matches and model of the chosen frames, made in a folder and repeatable."""

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
    except Exception as error:
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


def mapped(database: Path, images: Path, folder: Path, *, mapper: str, camera_known: bool) -> list[Any]:
    """Return the models of a database, the one with most images first; none if no pair is good enough."""
    import pycolmap

    count = in_process(_map, database, images, folder, mapper, camera_known)
    models = [pycolmap.Reconstruction(folder / str(number)) for number in range(count)]
    return sorted(models, key=lambda model: -model.num_reg_images())


def _map(database: Path, images: Path, folder: Path, mapper: str, camera_known: bool) -> int:
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
        if camera_known:
            options.ba_refine_focal_length = options.ba_refine_extra_params = False
        models = pycolmap.incremental_mapping(database, images, folder, options)
    for number, model in models.items():
        (folder / str(number)).mkdir(exist_ok=True)
        model.write(folder / str(number))
    return len(models)


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
