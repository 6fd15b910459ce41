"""Options under which COLMAP's mappers accept the short baselines of exposures.

The virtual images of one exposure (:mod:`blur2view.exposure_views`) lie millimetres to centimetres apart:
the rays of a point meet at hundredths or tenths of a degree, where COLMAP asks for 16 degrees to begin a
model and for 1.5 to keep a point; and without other images every track has two views, which COLMAP ignores.
The functions return pycolmap's own options, to be changed at will.
"""

from __future__ import annotations

from typing import Any

MIN_ANGLE_DEG = 0.02
"""Least angle between the rays of a point: a hand that moves by 5 mm sees 3 m away at 0.1 degrees."""


def mapper_options(*, linked: bool = False, refine_intrinsics: bool | None = None, seed: int = 0) -> Any:
    """Options for ``pycolmap.incremental_mapping`` of a database that ``blur2view to-colmap`` wrote.

    Parameters
    ----------
    linked : bool
        False: a database of exposures alone, each of which is a model of two images. True: the views stand
        beside the photographs of an ordinary project (``--link``). Its wide baselines then begin the model
        and make the points, and only what would refuse the views is changed.
    refine_intrinsics : bool, optional
        Whether bundle adjustment refines focal length and distortion. Default: in linked projects, as COLMAP
        does. Two views of one exposure cannot tell a focal length from a depth: give it to ``to-colmap``.
    seed : int
        Of the mapper's samples, so that a run with one thread repeats; -1 leaves it to the clock.

    Returns
    -------
    pycolmap.IncrementalPipelineOptions
        What differs from the defaults of pycolmap 4.2, for exposures alone:

        - ``triangulation.ignore_two_view_tracks`` off: a smear is a track of two views; there is no other.
        - ``triangulation.min_angle``, ``mapper.filter_min_tri_angle`` and ``mapper.init_min_tri_angle`` at
          `MIN_ANGLE_DEG`: the defaults (1.5, 1.5, 16) drop most points and every pair.
        - ``mapper.init_max_forward_motion`` 1: the default 0.95 refuses who walks forward.
        - ``mapper.init_max_error`` 2 px: at the default 4 most exposures pass for a plane.
        - ``mapper.init_min_num_inliers`` 50, not 100: a small or plain picture has few sure smears.
        - ``min_model_size`` 2: every exposure is a model of its own, of two images.
        - ``extract_colors`` off: no file holds the pixels of a virtual image.

        Linked: ``min_model_size`` 3 and ``extract_colors`` off.

    Examples
    --------
    >>> mapper_options().triangulation.ignore_two_view_tracks
    False
    """
    import pycolmap

    options = pycolmap.IncrementalPipelineOptions()
    refine = linked if refine_intrinsics is None else refine_intrinsics
    options.ba_refine_focal_length = options.ba_refine_extra_params = refine
    options.mapper.abs_pose_refine_focal_length = options.mapper.abs_pose_refine_extra_params = refine
    options.random_seed = seed
    options.extract_colors = False
    options.min_model_size = 3
    if not linked:
        _accept_exposures(options)
    return options


def _accept_exposures(options: Any) -> None:
    """Let pycolmap.IncrementalPipelineOptions build models of single exposures, in place."""
    options.min_model_size = 2
    options.triangulation.ignore_two_view_tracks = False
    options.triangulation.min_angle = MIN_ANGLE_DEG
    options.mapper.filter_min_tri_angle = MIN_ANGLE_DEG
    options.mapper.init_min_tri_angle = MIN_ANGLE_DEG
    options.mapper.init_max_forward_motion = 1.0
    options.mapper.init_min_num_inliers = 50
    options.mapper.init_max_error = 2.0


def global_options(*, refine_intrinsics: bool = True, seed: int = 0) -> Any:
    """Options for ``pycolmap.global_mapping`` of a database with linked views.

    The recipe: ``blur2view to-colmap --link --db DB IMG...``, then ``pycolmap.global_mapping(DB, IMAGES, OUT,
    global_options())``. The mapper averages rotations over the two-view geometries of photographs and views
    alike, so ours must be there.

    Parameters
    ----------
    refine_intrinsics : bool
        Whether bundle adjustment refines focal length and distortion.
    seed : int
        Of the mapper's samples; -1 leaves it to the clock.

    Returns
    -------
    pycolmap.GlobalPipelineOptions
    """
    import pycolmap

    options = pycolmap.GlobalPipelineOptions()
    options.random_seed = seed
    options.mapper.bundle_adjustment.refine_focal_length = refine_intrinsics
    options.mapper.bundle_adjustment.refine_extra_params = refine_intrinsics
    return options
