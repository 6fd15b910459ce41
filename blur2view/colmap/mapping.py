"""Options under which COLMAP's mappers accept the short baselines of exposures.

The virtual images of one exposure (:mod:`blur2view.exposure.views`) lie millimetres to centimetres apart:
the rays of a point meet at hundredths or tenths of a degree, where COLMAP asks for 16 degrees to begin a
model and for 1.5 to keep a point; and without other images every track has two views, which COLMAP ignores.
A mapper weighs all smears the same: it knows neither their standard deviations, nor that the errors of
neighbours are correlated. `triangulate_exposure` keeps the estimated poses; in a video the frames' poses say
most of what the camera did while the shutter was open: `place_views` leans on them.

Ways to map
-----------
The exposures of a fresh database, each by itself: a model of two images of each whose translation is known::

    import pycolmap
    import blur2view

    pycolmap.incremental_mapping("new.db", ".", "exposures", blur2view.mapper_options())

One exposure with the pose that was estimated, only its points triangulated::

    import blur2view

    model = blur2view.triangulate_exposure("new.db", "a.jpg")

The views of a linked project, which join a model of its photographs and leave it as it is; or both anew, one
by one or at once::

    import pycolmap
    import blur2view

    options = blur2view.mapper_options(linked=True, keep_photographs=True)
    pycolmap.incremental_mapping("project.db", "frames", "joined", options, input_path="model/0")
    pycolmap.incremental_mapping("project.db", "frames", "anew", blur2view.mapper_options(linked=True))
    pycolmap.global_mapping("project.db", "frames", "global", blur2view.global_options())
"""

import os
import sqlite3
import tempfile
from contextlib import closing
from pathlib import Path
from typing import Any

from blur2view.colmap.connection import open_read_only
from blur2view.colmap.project import image_names
from blur2view.errors import DatabaseError
from blur2view.exposure.views import CLOSE, OPEN

MIN_ANGLE_DEG = 0.02
"""Least triangulation angle: a hand that moves by 5 mm sees a point 3 m away at 0.1 degrees."""
SEED = 0  # of a mapper's samples, so that a run with one thread repeats
SOLVER_SECONDS = 600.0  # after which each bundle adjustment of the global mapper, a few, returns what it has


def mapper_options(*, linked: bool = False, keep_photographs: bool = False) -> Any:
    """Return options for ``pycolmap.incremental_mapping`` of a database that ``blur2view to-colmap`` wrote.

    Parameters
    ----------
    linked : bool
        False: a database of exposures alone, two images each, which do not determine the focal length: pass
        it to ``to-colmap``. True: the views stand beside the photographs of an ordinary project (``--link``),
        whose wide baselines begin the model, and only what would refuse the views is changed.
    keep_photographs : bool
        Of a linked project: leave the poses of photographs in the model that ``input_path`` names as they
        are, and the intrinsics: smears, which err more than features do, cannot bend it.

    Returns
    -------
    pycolmap.IncrementalPipelineOptions
        The source says why each value differs from the default of pycolmap 4.2.

    Raises
    ------
    ValueError
        If photographs are to be kept where there are none.

    Examples
    --------
    >>> mapper_options().triangulation.ignore_two_view_tracks
    False
    """
    import pycolmap

    if keep_photographs and not linked:
        raise ValueError("keep_photographs is for linked projects")
    options = pycolmap.IncrementalPipelineOptions()
    refine = linked and not keep_photographs
    options.ba_refine_focal_length = options.ba_refine_extra_params = refine
    options.mapper.abs_pose_refine_focal_length = options.mapper.abs_pose_refine_extra_params = refine
    options.random_seed = SEED
    options.extract_colors = False  # no file holds the pixels of a virtual image
    options.fix_existing_frames = keep_photographs
    if linked:
        options.min_model_size = 3
        # not 30: a view sees only points whose smears are confident. None of its matches is a mistake of
        # appearance, as its keypoints are the photograph's, moved.
        options.mapper.abs_pose_min_num_inliers = 8
        return options
    options.min_model_size = 2  # in a database of many exposures each is a model of two images
    options.triangulation.ignore_two_view_tracks = False  # a smear is a track of two views; there is no other
    options.triangulation.min_angle = MIN_ANGLE_DEG  # not 1.5, of points made later or of an exposure alone
    options.mapper.filter_min_tri_angle = MIN_ANGLE_DEG  # 1.5 drops most points
    options.mapper.init_min_tri_angle = MIN_ANGLE_DEG  # 16 refuses every pair
    options.mapper.init_max_forward_motion = 1.0  # 0.95 refuses who walks forward
    options.mapper.init_min_num_inliers = 50  # not 100: a small or plain picture has few confident smears
    options.mapper.init_max_error = 2.0  # 4 px forgive a third of a smear
    return options


def global_options() -> Any:
    """Return pycolmap.GlobalPipelineOptions for ``pycolmap.global_mapping`` of a database with linked views.

    pycolmap 4.2 limits the time of neither positioning nor the whole: who needs that maps in a process that
    can be ended.
    """
    import pycolmap

    options = pycolmap.GlobalPipelineOptions()
    options.random_seed = SEED
    options.mapper.bundle_adjustment.ceres.solver_options.max_solver_time_in_seconds = SOLVER_SECONDS
    return options


def triangulate_exposure(database: str | os.PathLike[str], name: str) -> Any:
    """Return the model of one exposure with the estimated poses, unchanged, and triangulated points.

    Parameters
    ----------
    database : path-like
        That ``blur2view to-colmap`` wrote with known intrinsics; it is only read.
    name : str
        Of the photograph.

    Returns
    -------
    pycolmap.Reconstruction
        Of two images, the open one at the origin, the close one at cam2_from_cam1, and their points.

    Raises
    ------
    DatabaseError
        If the database lacks the views or a pose between them, or that pose has no translation.
    """
    import pycolmap

    names = name + OPEN, name + CLOSE
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "exposure.db"  # pycolmap writes to what it opens
        with open_read_only(Path(database)) as source, closing(sqlite3.connect(copy)) as target:
            ids = image_names(source)
            if not set(names) <= ids.keys():
                raise DatabaseError(f"{database}: has no views of {name}; add them with blur2view to-colmap")
            source.backup(target)
        with pycolmap.Database.open(copy) as opened:
            images = [opened.read_image(ids[view]) for view in names]
            camera = opened.read_camera(images[0].camera_id)
            geometry = opened.read_two_view_geometry(*(ids[view] for view in names))
        if (motion := geometry.cam2_from_cam1) is None:
            raise DatabaseError(f"{database}: has no pose of {name}; give to-colmap its intrinsics (--focal)")
        if not motion.translation.any():
            raise DatabaseError(f"{database}: the translation of {name} is undecided: nothing to triangulate")
        model, options = pycolmap.Reconstruction(), mapper_options()
        options.image_names = names
        model.add_camera_with_trivial_rig(camera)
        for image, pose in zip(images, (pycolmap.Rigid3d(), motion), strict=True):
            view = pycolmap.Image(name=image.name, camera_id=image.camera_id, image_id=image.image_id)
            model.add_image_with_trivial_frame(view, pose)
        return pycolmap.triangulate_points(model, copy, folder, folder, True, options, False)
