"""COLMAP's features, matches and model of the chosen frames, made in a folder and repeatable."""

import shutil
import sqlite3
from collections.abc import Sequence
from contextlib import closing, suppress
from itertools import combinations, count, product
from math import comb
from pathlib import Path
from typing import Any

import numpy as np

from blur2view.colmap.contrast import write_stretched
from blur2view.colmap.mapping import SEED, SOLVER_SECONDS, blurred_options
from blur2view.colmap.models import registered_images, write_model
from blur2view.colmap.project import connect
from blur2view.colmap.recovery_run import Show
from blur2view.errors import DatabaseError
from blur2view.images.image import read_picture
from blur2view.reconstruction.colmap_process import in_process, tell
from blur2view.reconstruction.options import ReconstructionOptions
from blur2view.reconstruction.scene import DATABASE, IMAGES, WORK, Step

MIN_REGISTERED = 0.5  # share of the mapped frames; with fewer they are read anew by `blurred_options`
EXHAUSTIVE = 150  # frames up to which all pairs are matched
# Where COLMAP's 16 degrees and 1.2 make too small a model. Of the middle 20 frames of RedKitchen, of a focal
# length of 0.85, they register 4 of an unknown camera, these 20; of a known one none and 20.
NEAR_ANGLE_DEG = 4.0  # at which a point of the first pair is seen
FOCAL_SHARE = 0.85  # of the longer side: the focal length of an unknown camera, at first
NEIGHBOURS = tuple(2**k for k in range(10))  # of more frames: how far apart those of a pair are
LOOP_STEP = 10  # one in so many frames is matched with all others of these, which finds loops
MIN_OBSERVED = 30  # points in the mean frame of a model: as many as COLMAP asks for to register a frame
MIN_FEATURES = 100  # in the median frame; fewer are too little texture
STILL_WAY = 0.02  # of the picture's side: a camera whose picture moves less all the while stood still
STOOD_STILL = "the camera stood still; move it sideways past the scene"
PANORAMIC = (4, 5, 6)  # COLMAP's configurations of planes, rotations, and either


def nobody(done: int, count: int) -> None:
    """Show nothing of what is done."""


def map_frames(
    folder: Path, sets: Sequence[Sequence[str]], options: ReconstructionOptions, way: float, step: Step
) -> dict[str, Any]:
    """Write COLMAP's database and its largest model; DatabaseError if it makes none.

    The ``sets`` of frames, the sharpest first, are tried until most frames of one are registered; at last the
    first one is read as `blurred_options` says. The largest model is taken.
    """
    work, images, models, best = folder / WORK, folder / IMAGES, list[Any](), sets[0]
    camera = options.for_colmap(read_picture(images / best[0], as_stored=True).size)
    tries = [*((number, names, False) for number, names in enumerate(sets)), (len(sets), sets[0], True)]
    for (number, names, blurred), again in product(tries, (False, True)):
        if again and options.mapper == "global":
            continue
        database, there = work / f"matches_{number}.db", work / "models"
        if not again:
            of_which = " of blurred frames" if blurred else ""
            with step(f"finding features{of_which}") as show:
                readable = _stretched(images, work / "stretched", names) if blurred else images
                find_features(database, readable, names, camera=camera, blurred=blurred, show=show)
            with step(f"matching features{of_which}") as show:
                match(database, names, blurred=blurred, show=show)
        else:  # on a copy, because the mapper may change it, and a killed call begins with the first one
            database = copied(database, work / f"matches_{number}_again.db")
        with step("mapping" + (" again" if again else "")) as show:
            shutil.rmtree(there, ignore_errors=True)
            known = bool(options.camera)
            found = mapped(
                database, images, there, mapper=options.mapper, camera_known=known, again=again, show=show
            )
        if found and (not models or found[0].num_reg_images() > models[0].num_reg_images()):
            models, best = found, names
            shutil.copyfile(database, work / "best.db")
        if models and models[0].num_reg_images() >= MIN_REGISTERED * len(names):
            break
    if not models:
        why = why_no_model(work / "matches_0.db", way, weak=any(there.glob("*/images.bin")))
        raise DatabaseError(f"{folder}: COLMAP made no model of {len(sets[-1])} frames: {why}")
    write_model(models[0], work / "model", images, folder / DATABASE)
    (work / "best.db").replace(folder / DATABASE)
    largest, *others = (set(registered_images(model)) for model in models)
    return {"mapped": list(best), "others": [len(other - largest) for other in others if other - largest]}


def _stretched(images: Path, copies: Path, names: Sequence[str]) -> Path:
    """Return where COLMAP finds features: in copies if the contrast of any frame is stretched there."""
    shutil.rmtree(copies, ignore_errors=True)
    return copies if write_stretched(images, copies, names) else images


def find_features(
    database: Path,
    images: Path,
    names: Sequence[str],
    *,
    camera: tuple[str, str],
    blurred: bool,
    show: Show = nobody,
) -> None:
    """Write features of images; a database that was begun is gone on with.

    ``camera`` is COLMAP's model and parameters, empty if unknown. ``blurred`` frames are read as
    `blurred_options` says.
    """

    def watch(told: int) -> None:
        show(_count(database, "keypoints"), len(names))

    in_process(_find_features, database, images, names, camera, blurred, watch=watch)


def _find_features(
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
    features = blurred_options()[0] if blurred else pycolmap.FeatureExtractionOptions()
    features.use_gpu = False
    pycolmap.extract_features(
        database,
        images,
        image_names=list(names),
        camera_mode=pycolmap.CameraMode.SINGLE,
        reader_options=reader,
        extraction_options=features,
    )


def match(database: Path, names: Sequence[str], *, blurred: bool, show: Show = nobody) -> None:
    """Write verified matches of images whose features are found; what was begun is gone on with.

    ``blurred`` frames are all matched, as `blurred_options` says.
    """
    pairs = None if blurred or len(names) <= EXHAUSTIVE else pairs_of(names)
    every = comb(len(names), 2) if pairs is None else len(pairs)

    def watch(told: int) -> None:
        show(_count(database, "matches"), every)

    in_process(_match, database, pairs, blurred, watch=watch)


def pairs_of(names: Sequence[str]) -> list[tuple[str, str]]:
    """Return the pairs of many frames that are matched: a power of two apart, and those that find loops."""
    near = [(k, k + apart) for apart in NEIGHBOURS for k in range(len(names) - apart)]
    loops = combinations(range(0, len(names), LOOP_STEP), 2)
    return [(names[a], names[b]) for a, b in sorted({*near, *loops})]


def _match(database: Path, pairs: Sequence[tuple[str, str]] | None, blurred: bool) -> None:
    """Match ``pairs``, or all."""
    import pycolmap

    matching = blurred_options()[1] if blurred else pycolmap.FeatureMatchingOptions()
    matching.use_gpu = False
    verifying = pycolmap.TwoViewGeometryOptions()
    verifying.ransac.random_seed = SEED
    common: dict[str, Any] = {"matching_options": matching, "verification_options": verifying}
    if pairs is None:
        pycolmap.match_exhaustive(database, **common)
        return
    listed = database.with_suffix(".pairs.txt")
    listed.write_text("".join(f"{a} {b}\n" for a, b in pairs))
    pairing = pycolmap.ImportedPairingOptions(match_list_path=listed)
    pycolmap.match_image_pairs(database, pairing_options=pairing, **common)
    listed.unlink()


def mapped(
    database: Path,
    images: Path,
    folder: Path,
    *,
    mapper: str,
    camera_known: bool,
    again: bool = False,
    show: Show = nobody,
) -> list[Any]:
    """Return the models of a database, the one with most images first; none if no pair is good enough.

    One that has lost the points by which its frames were registered is left out.

    Tried ``again``, the incremental mapper begins with a nearer pair, and a shorter focal length if it is
    unknown, which the database has then.
    """
    import pycolmap

    every = len(_rows(database, "SELECT name FROM images"))

    def watch(told: int) -> None:
        if told:  # the global mapper tells nothing
            show(min(told, every), every)

    found = in_process(_map, database, images, folder, mapper, camera_known, again, watch=watch)
    models = [pycolmap.Reconstruction(folder / str(number)) for number in range(found)]
    models = [model for model in models if model.compute_mean_observations_per_reg_image() >= MIN_OBSERVED]
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
        registered = count(3)  # the first pair is there
        models = pycolmap.incremental_mapping(
            database, images, folder, options, next_image_callback=lambda: tell(next(registered))
        )
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


def why_no_model(database: Path, way: float, *, weak: bool) -> str:
    """Return why COLMAP made no model of a database, with a remedy.

    ``way`` is how far the picture moved; ``weak`` says that there were models, but of too few points.
    """
    features = [count for (count,) in _rows(database, "SELECT rows FROM keypoints")]
    if not features or np.median(features) < MIN_FEATURES:
        return "half of the frames have fewer than 100 features; use more light, or film things with texture"
    if way < STILL_WAY:
        return STOOD_STILL
    pairs = [config for (config,) in _rows(database, "SELECT config FROM two_view_geometries WHERE rows > 0")]
    if not pairs:
        return "no two frames show the same things sharply; move more slowly, or raise --frames"
    if np.mean(np.isin(pairs, PANORAMIC)) > 0.5:
        return "the camera only turned, or saw a single plane; move it sideways past the scene"
    if weak:
        return f"a model has under {MIN_OBSERVED} points a frame; use more light, or film things with texture"
    return "no two frames were taken far enough apart; move the camera sideways past the scene"


def _count(database: Path, table: str) -> int:
    """Return how many rows a table has, which another process fills; 0 where that cannot be read now."""
    with suppress(DatabaseError):
        return sum(number for (number,) in _rows(database, f"SELECT count(*) FROM {table}"))
    return 0


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
