"""Options under which COLMAP's mappers accept the short baselines of exposures.

The virtual images of one exposure (:mod:`blur2view.exposure.views`) lie millimetres to centimetres apart:
the rays of a point meet at hundredths or tenths of a degree, where COLMAP asks for 16 degrees to begin a
model and for 1.5 to keep a point; and without other images every track has two views, which COLMAP ignores.
A mapper weighs all smears the same, and knows nothing of the errors that neighbours share; `place_views`
does. Each exposure of a fresh database by itself::

    import blur2view
    import pycolmap

    pycolmap.incremental_mapping("new.db", ".", "exposures", blur2view.mapper_options())

The views of a linked project, which join a model of its photographs and leave it as it is; or both anew, one
by one or at once::

    import blur2view
    import pycolmap

    options = blur2view.mapper_options(linked=True, keep_photographs=True)
    pycolmap.incremental_mapping("project.db", "frames", "joined", options, input_path="model/0")
    pycolmap.incremental_mapping("project.db", "frames", "anew", blur2view.mapper_options(linked=True))
    pycolmap.global_mapping("project.db", "frames", "global", blur2view.global_options())
"""

from typing import Any

MIN_ANGLE_DEG = 0.02  # of triangulation: a hand that moves by 5 mm sees a point 3 m away at 0.1 degrees
SEED = 0  # of a mapper's samples, so that a run with one thread repeats
SOLVER_SECONDS = 600.0  # after which each bundle adjustment of the global mapper, a few, returns what it has


def mapper_options(*, linked: bool = False, keep_photographs: bool = False) -> Any:
    """Return pycolmap.IncrementalPipelineOptions for a database that ``blur2view to-colmap`` wrote.

    Parameters
    ----------
    linked : bool
        Whether the database holds views beside a project's photographs; else it holds exposures alone, which
        do not determine the focal length.
    keep_photographs : bool
        Whether the photographs' model, which ``input_path`` names, stays as it is.

    Returns
    -------
    pycolmap.IncrementalPipelineOptions
        Options of ``pycolmap.incremental_mapping``.

    Examples
    --------
    >>> from blur2view import mapper_options
    >>> mapper_options().ba_refine_focal_length, mapper_options(linked=True).ba_refine_focal_length
    (False, True)
    """
    import pycolmap

    options = pycolmap.IncrementalPipelineOptions()
    refine = linked and not keep_photographs
    options.ba_refine_focal_length = options.ba_refine_extra_params = refine
    options.mapper.abs_pose_refine_focal_length = options.mapper.abs_pose_refine_extra_params = refine
    options.random_seed = SEED
    options.extract_colors = False  # no file holds the pixels of a virtual image
    options.fix_existing_frames = keep_photographs
    if linked or keep_photographs:
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
    options.mapper.init_max_error = 2.0  # COLMAP's 4 px would accept errors of a third of a smear
    return options


def global_options() -> Any:
    """Return options for COLMAP's global mapper of a database with linked views.

    Returns
    -------
    pycolmap.GlobalPipelineOptions
        Options of ``pycolmap.global_mapping``: a seed, and a bound of the time of its bundle adjustments.

    Examples
    --------
    >>> from blur2view import global_options
    >>> global_options().random_seed
    0
    """
    import pycolmap

    options = pycolmap.GlobalPipelineOptions()
    options.random_seed = SEED
    options.mapper.bundle_adjustment.ceres.solver_options.max_solver_time_in_seconds = SOLVER_SECONDS
    return options


def blurred_options() -> tuple[Any, Any]:
    """Return options of COLMAP's features and matches for blurred photographs.

    Of RedKitchen's frames with smears of 37 px COLMAP's defaults register none of 11, these 11; with 51 px
    none and 7 of 8. They take about ten seconds for a photograph of 640x480. Under water and in the dark
    give them `write_stretched` copies.

    Returns
    -------
    features : pycolmap.FeatureExtractionOptions
        Options of ``pycolmap.extract_features``: SIFT with affine shapes and domain-size pooling.
    matching : pycolmap.FeatureMatchingOptions
        Options of ``pycolmap.match_exhaustive``, which is then guided by the geometry.

    References
    ----------
    Dong and Soatto, Domain-size pooling in local descriptors: DSP-SIFT, CVPR 2015.

    Examples
    --------
    >>> from blur2view import blurred_options
    >>> features, matching = blurred_options()
    >>> features.sift.domain_size_pooling, matching.guided_matching
    (True, True)
    """
    import pycolmap

    features, matching = pycolmap.FeatureExtractionOptions(), pycolmap.FeatureMatchingOptions()
    features.use_gpu = False  # domain-size pooling has no other way
    features.sift.domain_size_pooling = features.sift.estimate_affine_shape = True
    features.sift.peak_threshold = 0.0033
    matching.guided_matching = True
    return features, matching
