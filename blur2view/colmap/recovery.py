"""Frames that are too blurred for COLMAP, registered in its model of the others.

`frame_sequence` says how one is; here all are, by one process or several, and put into the model.
"""

import os
from collections.abc import Callable, Collection, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from blur2view.camera import to_colmap
from blur2view.colmap.blurred_pose import pose_at
from blur2view.colmap.frame_sequence import FrameSequence, RecoveredFrame
from blur2view.colmap.models import DatabaseIds, add_image, observed, read_ids, registered_images, set_pose
from blur2view.colmap.project import image_names, open_read_only, read_keypoints
from blur2view.colmap.recovery_run import Notes, recover_all, set_aside_blurred
from blur2view.colmap.warped_view import projected
from blur2view.exposure.sequence import frame_names
from blur2view.exposure.views import CLOSE, OPEN
from blur2view.networks.smear_network import SmearNetwork, SmearReader

NO_POINTS = np.zeros((0, 2))
MAX_KEYPOINT_PX = 2.0  # from a keypoint of a database to the point that it shows


@dataclass(frozen=True, kw_only=True, eq=False)
class Recovery:
    """COLMAP's model of a video, and what became of the frames that it lacked."""

    model: Any
    """pycolmap.Reconstruction with the recovered frames, and their views where these were asked for."""
    registered: tuple[str, ...]  # frames that have the model's pose, in order of time
    recovered: Mapping[str, RecoveredFrame]  # by name, in order of time
    refused: Mapping[str, str]  # why every other frame is not believed or cannot be read
    sequence: "FrameSequence"  # with which `track_frames` goes on


def recover_frames(
    model: str | os.PathLike[str],
    frames: str | os.PathLike[str],
    names: Sequence[str] | None = None,
    *,
    database: str | os.PathLike[str] | None = None,
    keep_keypoints: bool = False,
    max_smear_px: float | None = None,
    views: bool | None = None,
    refine: bool = False,
    network: SmearReader | None = None,
    jobs: int = 1,
    notes: str | os.PathLike[str] | None = None,
    show: Callable[[int, int], None] = lambda done, count: None,
) -> Recovery:
    """Register the frames of a video that COLMAP's model lacks; others keep their poses, unless asked for.

    Recovered frames observe points of the model. Nothing is written: `Recovery.model` is pycolmap's.

    Parameters
    ----------
    model : path
        Folder of COLMAP's model, with two frames or more.
    frames : path
        Folder of the frames, all of one video.
    names : sequence of str, optional
        All frames in order, as COLMAP calls them: their paths in ``frames``; by default all photographs in
        that folder and below it. The numbers in names that differ in nothing else are times (`frame_times`).
    database : path, optional
        COLMAP's project, from which recovered frames have their ids.
    keep_keypoints : bool
        Whether recovered frames keep the keypoints that they have in the database, so that COLMAP's mappers
        go on with both. They observe fewer points: those that were found where a keypoint is.
    max_smear_px : float, optional
        Frames of the model with longer smears, in pixels, and those that see little and do not fit the others
        (`FrameSequence.misplaced`), get a new pose from the others; those for which none is found keep
        theirs. By default all do.
    views : bool, optional
        Whether a recovered frame's poses at shutter-open and shutter-close become images NAME#open and
        NAME#close, for which there are no files; by default if the model has such images.
    refine : bool
        Whether recovered poses and the model's points are adjusted together.
    network : SmearReader, optional
        Reads smears; by default a new `SmearNetwork`.
    jobs : int
        Processes that work on frames; any number gives the same model. A script that asks for more than one
        runs under ``if __name__ == "__main__":``.
    notes : path, optional
        A file in which each frame is noted as it is done: an interrupted call, or a killed one, goes on where
        it stopped when it is repeated. That of another call begins anew.
    show : callable, optional
        Gets how many frames are done, of how many; first of those whose smears are read for ``max_smear_px``.

    Returns
    -------
    Recovery
        The model with the recovered frames, and what became of every frame.

    Raises
    ------
    DatabaseError
        If the model cannot be read, or has fewer than two of the frames.
    OutputError
        If ``notes`` cannot be written, or was not written by an earlier call.
    RunError
        If a process dies, or cannot be started.

    Examples
    --------
    >>> from blur2view import recover_frames
    >>> recovery = recover_frames("model", "frames")  # which lacks one of five frames
    >>> list(recovery.recovered), recovery.model.num_reg_images()
    (['f_3.png'], 5)
    """
    names = frame_names(frames) if names is None else names
    sequence = FrameSequence(Path(model), Path(frames), names, network or SmearNetwork())
    if keep_keypoints and database is None:
        raise ValueError("keep_keypoints needs the database with these keypoints")
    ids = None if database is None else read_ids(Path(database))
    noted = None if notes is None else Notes(Path(notes), sequence, max_smear_px)
    if max_smear_px is not None:
        set_aside_blurred(sequence, max_smear_px, jobs=jobs, notes=noted, show=show)
    recover_all(sequence, jobs=jobs, notes=noted, show=show)
    keypoints_db = Path(database) if keep_keypoints and database is not None else None
    return finished_recovery(sequence, ids, keypoints_db, views=views, refine=refine)


def finished_recovery(
    sequence: FrameSequence,
    ids: DatabaseIds | None = None,
    keypoints_db: Path | None = None,
    *,
    views: bool | None = None,
    refine: bool = False,
) -> Recovery:
    """Return a sequence's model to which its recovered frames are added, as `recover_frames` says.

    ``keypoints_db`` is the database whose keypoints they keep.
    """
    if views is None:
        views = any(image.name.endswith((OPEN, CLOSE)) for image in sequence.model.images.values())
    before = None if keypoints_db is None else deepcopy(sequence.model)
    recovered = [name for name in sequence.times if name in sequence.recovered]
    for name in recovered:
        _add_frame(sequence, name, ids)
    if refine and recovered:
        free = [name for name in recovered if name not in sequence.aside]
        adjust(sequence.model, free, displaced=sequence.aside)
    if keypoints_db is not None:
        sequence.model = _with_keypoints(sequence, before, keypoints_db, ids)
    for name in recovered if views else ():
        _add_views(sequence, name, ids)
    return Recovery(
        model=sequence.model,
        registered=tuple(
            name
            for name in sequence.times
            if name in sequence.images or (name in sequence.aside and name not in sequence.recovered)
        ),
        recovered={name: sequence.recovered[name] for name in sequence.times if name in sequence.recovered},
        refused={
            name: sequence.refused[name]
            for name in sequence.times
            if name in sequence.refused and name not in sequence.aside
        },
        sequence=sequence,
    )


def _add_frame(sequence: FrameSequence, name: str, ids: DatabaseIds | None) -> None:
    """Add a recovered frame to the model and its observations to the tracks, or set the pose of its own."""
    import pycolmap

    frame, beside = sequence.recovered[name], sequence.images[sequence.near(name)[0]]
    if name in sequence.aside:
        set_pose(sequence.model, name, frame.pose)
        return
    image = add_image(sequence.model, name, frame.pose, to_colmap(frame.pixels), beside, ids)
    for keypoint, number in enumerate(frame.points):
        sequence.model.add_observation(int(number), pycolmap.TrackElement(image.image_id, keypoint))


def _with_keypoints(sequence: FrameSequence, before: Any, database: Path, ids: DatabaseIds | None) -> Any:
    """Return the model ``before`` with the frames of a sequence's and a database's keypoints of these."""
    import pycolmap

    after = sequence.model
    for number, point in after.points3D.items():
        before.points3D[number].xyz = point.xyz
    with open_read_only(database) as opened:
        image_ids = image_names(opened)
        present = {name: image_ids[name] for name in sequence.recovered if name in image_ids}
        stored = {name: read_keypoints(opened, number) for name, number in present.items()}
    for name in (name for name in sequence.times if name in sequence.recovered):
        frame, beside = sequence.recovered[name], sequence.images[sequence.near(name)[0]]
        pose = after.find_image_with_name(name).cam_from_world().matrix()
        if name in sequence.aside:
            set_pose(before, name, pose)
            continue
        keypoints = stored.get(name, NO_POINTS)
        image = add_image(before, name, pose, keypoints, beside, ids)
        if not len(keypoints):
            continue
        away, nearest = cKDTree(keypoints).query(to_colmap(frame.pixels))
        order = np.argsort(away, kind="stable")
        _, first = np.unique(nearest[order], return_index=True)
        for index in order[first][away[order[first]] < MAX_KEYPOINT_PX]:
            element = pycolmap.TrackElement(image.image_id, int(nearest[index]))
            before.add_observation(int(frame.points[index]), element)
    return before


def _add_views(sequence: FrameSequence, name: str, ids: DatabaseIds | None) -> None:
    """Add both ends of a recovered frame's exposure, with the projections of its points as keypoints."""
    model, frame = sequence.model, sequence.recovered[name]
    image, world = model.find_image_with_name(name), sequence.world(frame.points)
    for end, t in ((OPEN, -0.5), (CLOSE, 0.5)):
        pose = pose_at(t, image.cam_from_world().matrix(), frame.motion)
        pixels = projected(model.cameras[image.camera_id], world @ pose[:, :3].T + pose[:, 3])
        keypoints = to_colmap(np.where(np.isfinite(pixels), pixels, frame.pixels))
        add_image(model, name + end, pose, keypoints, image, ids)


def adjust(model: Any, free: Collection[str], displaced: Collection[str] = ()) -> None:
    """Adjust the points of a model and the poses of its images named ``free``; all else stays.

    Nothing is taken from the keypoints of ``displaced`` images, which COLMAP found where the blur put them.
    """
    import pycolmap

    options, config = pycolmap.BundleAdjustmentOptions(), pycolmap.BundleAdjustmentConfig()
    options.refine_focal_length = options.refine_extra_params = options.refine_principal_point = False
    options.print_summary, options.min_track_length = False, 2
    for image in registered_images(model).values():
        config.add_image(image.image_id)
        if image.name not in free:
            config.set_constant_rig_from_world_pose(image.frame_id)
    adjusted = deepcopy(model)
    for image in registered_images(adjusted).values():
        for keypoint in observed(adjusted, image) if image.name in displaced else ():
            if image.points2D[keypoint].has_point3D():  # which goes with the last but one that sees it
                adjusted.delete_observation(image.image_id, keypoint)
    for number, point in list(adjusted.points3D.items()):
        if point.track.length() < 2:  # on which pycolmap ends
            adjusted.delete_point3D(number)
    pycolmap.create_default_bundle_adjuster(options, config, adjusted).solve()
    for number, point in adjusted.points3D.items():
        model.points3D[number].xyz = point.xyz
    for image in registered_images(model).values():
        if image.name in free:
            image.frame.rig_from_world = adjusted.images[image.image_id].frame.rig_from_world
