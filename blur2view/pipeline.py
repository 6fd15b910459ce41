"""The whole path in one call: photograph -> smears and blur -> ambiguous matches -> two-view geometry."""

import os
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from blur2view import __version__
from blur2view.arrays import AnyArray, require
from blur2view.camera import LONG_S, SHORT_S, Camera
from blur2view.geometry.pose import AngularVelocity
from blur2view.geometry.rolling_shutter import RollingShutter
from blur2view.geometry.two_view_geometry import TimeDirection, TwoViewGeometry
from blur2view.images.image import read_picture
from blur2view.images.pixels import as_photograph, unusable_size
from blur2view.movers.mask import MotionMask, motion_mask
from blur2view.movers.moving import BLOCK_PX, THRESHOLD, Moving, moving_in, reduced
from blur2view.networks.model_file import Execution, one_thread
from blur2view.networks.smear_network import Detail, SmearNetwork, SmearReader, is_named_by_looks
from blur2view.networks.spectra import STEP
from blur2view.records.record import Record, plain
from blur2view.smears.blur import Blur, nothing_seen
from blur2view.smears.camera_motion import Evidence, Needed
from blur2view.smears.grid import SmearGrid
from blur2view.smears.matches import SelectOptions, SmearMatches, select_matches
from blur2view.two_view.estimate import EstimatorOptions, estimate_two_view, without_fit, without_motion

if TYPE_CHECKING:
    from PIL import Image

CAMERAS = "made by Camera.from_focal(focal_px, (width, height)) or .from_opencv(K, dist, (width, height))"

BLUR_KEYS = (
    *("camera_moved", "nothing_seen", "smear_px", "smear_sigma_px"),
    *("direction_deg", "defocus_px", "defocus_sigma_px"),
)
MODEL_KEYS = "model", "parameters", "log_likelihood", "probability"
COVARIANCE_KEYS = "matrix", "tangents", "rotation_sigma_deg", "translation_sigma_deg"
RATE_KEYS = "wx", "wy", "wz", "sigma_wx", "sigma_wy", "sigma_wz"
"""What the record holds of `Blur`, `ModelRow`, `PoseCovariance` and `AngularVelocity`."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Estimate:
    """The estimate of one photograph, and every step that led to it; of N smears that were used."""

    grid: SmearGrid  # smears with their standard deviations, and kinds of blur, at the network's cells
    blur: Blur  # what blurred it: a geometry is looked for only where the camera moved
    matches: SmearMatches  # the N smears
    geometry: TwoViewGeometry  # F or None, the configuration with its reason, the masks of the N matches
    model_id: str  # name of the network's weights
    camera: Camera | None = None  # the intrinsics that were used
    shutter: RollingShutter | None = None  # for which geometry was corrected; matches are as recorded
    time: TimeDirection = field(default_factory=TimeDirection)  # whether neighbouring frames decided it
    timestamp_s: float | None = None  # when it was taken, as stated to `estimate_frames`, seconds
    moving: Moving | None = None  # what moves by itself, where the cells leave open if the camera moved
    execution: Execution = field(default_factory=Execution)  # what ran the network, and runs `segment`'s

    def __repr__(self) -> str:
        (height, width), config = self.grid.shape, self.geometry.config.name
        return f"<Estimate of {width}x{height} px: {self.blur.kind}, {config}>"

    def angular_velocity(self, exposure_s: float) -> AngularVelocity | None:
        """Return the rotation over the exposure time, with its covariance; None where the pose is unknown.

        Its sign is that of time, which is open unless ``time.known``; a gyroscope shows ``of_gyroscope``.
        With an exposure time of 1 it is the rotation itself, in radians. ValueError if the exposure time is
        not above 1e-9 seconds, 2 at most.
        """
        if not np.issubdtype(type(exposure_s), np.number) or not SHORT_S < exposure_s <= LONG_S:
            allowed = f"seconds above {SHORT_S:g}, {LONG_S:g} at most"
            raise ValueError(f"the exposure time must be {allowed}, got {exposure_s!r}")
        return self.geometry.angular_velocity(exposure_s)

    def record(self, *, name: str = "", mask: MotionMask | None = None, **stated: Any) -> Record:
        """Return the record, with the motion ``mask`` and other ``stated`` fields of `Record`.

        A rate is in rad/s if ``exposure_s`` is stated.
        """
        blur, geometry, camera = self.blur, self.geometry, self.camera
        height, width = self.grid.shape
        values = {
            "name": name,
            "width": width,
            "height": height,
            "blur": blur.kind,
            **{key: getattr(blur, key) for key in BLUR_KEYS},
            "moving_share": None if self.moving is None else blur.moving_share,
            "timestamp_s": self.timestamp_s,
            "model_ids": [self.model_id],
            "K": None if camera is None else camera.K,
            "camera": _part(camera, "model", "params", "source", "known"),
            **_geometry_fields(geometry),
            "reason": geometry.reason,
            "models": [_part(row, *MODEL_KEYS) for row in geometry.models],
            "independent_smears": geometry.independent_smears,
            "num_matches": len(self.matches),
            "num_inliers": int(geometry.inlier_mask.sum()),
            "support_by_chance": geometry.support_by_chance,
            "num_trials": geometry.num_trials,
            "inlier_ratio": geometry.inlier_ratio,
            "backward": None if geometry.backward is None else _geometry_fields(geometry.backward),
            "readout_s": None if self.shutter is None else self.shutter.readout_s,
            "time_known": self.time.known,
            "time_confidence": self.time.confidence,
        }
        if (rates := geometry.angular_velocity(stated.get("exposure_s") or 1.0)) is not None:
            values |= zip(RATE_KEYS, [*rates.mean, *rates.sigma], strict=True)
        if mask is not None:
            regions = [_part(region, "area_px", "box", "centroid", "probability") for region in mask.regions]
            values["mask"] = {"reason": mask.reason, "shares": mask.shares, "regions": regions}
            values["moving_share"] = mask.shares["moving"]
        return Record(**{key: plain(value) for key, value in (values | stated).items()})

    def to_json(self, name: str | os.PathLike[str] | None = None, exposure_s: float | None = None) -> str:
        """Return the JSON text of the record, with its use and verdict, as the commands write it.

        Parameters
        ----------
        name : str or path, optional
            What the photograph is called in it.
        exposure_s : float, optional
            Exposure time, seconds; then rates are in rad/s, otherwise rotations in rad.

        Returns
        -------
        str
            A JSON object; ``blur2view estimate --help-all`` explains its keys. What only a command knows, as
            the file's digest, is empty.

        Raises
        ------
        ValueError
            If the exposure time is not above 1e-9 s, or longer than 2 s.

        Examples
        --------
        >>> import json
        >>> import blur2view
        >>> document = json.loads(blur2view.estimate("models/sample.jpg").to_json("sample.jpg"))
        >>> document["name"], document["blur"], document["config"]
        ('sample.jpg', 'camera moved', 'UNCALIBRATED')
        """
        if exposure_s is not None:
            self.angular_velocity(exposure_s)  # which checks it
        named = self.record(name=os.fsdecode(name or ""), exposure_s=exposure_s, version=__version__)
        return named.with_use().to_json()


def _geometry_fields(geometry: TwoViewGeometry) -> dict[str, Any]:
    """Return the fields of a geometry in one order in time."""
    pose = geometry.cam2_from_cam1
    return {
        "F": geometry.F,
        "H": geometry.H,
        "E": None if pose is None else geometry.E,
        "cam2_from_cam1": _part(pose, "rotation", "translation"),
        "pose_covariance": _part(geometry.covariance, *COVARIANCE_KEYS),
        "config": geometry.config,
        "parallax": geometry.parallax,
    }


def _part(source: Any, *names: str) -> dict[str, Any] | None:
    """Return attributes of an object by their names; None of None."""
    return None if source is None else {name: getattr(source, name) for name in names}


@one_thread
def estimate(
    image: "AnyArray | Image.Image | str | os.PathLike[str]",
    *,
    network: SmearReader | str | os.PathLike[str] | None = None,
    select: SelectOptions | None = None,
    options: EstimatorOptions | None = None,
    rng: np.random.Generator | int | None = None,
    camera: Camera | None = None,
    shutter: RollingShutter | None = None,
    detail: Detail = Detail.GEOMETRY,
    geometry: bool = True,
    closer: bool = True,
) -> Estimate:
    """Return the two-view geometry of the camera's motion during one exposure.

    Parameters
    ----------
    image : ndarray of shape (H, W, 3), (H, W, 4) or (H, W), picture of Pillow, or path
        The photograph, sRGB-coded RGB or grey: uint8, uint16 or floats in [0, 1]; one of Pillow is not turned
        upright. Of a path, without ``camera``, the focal length of EXIF is a hint.
    network : SmearReader or path, optional
        The shipped `SmearNetwork` by default; load it once for many photographs.
    select, options : SelectOptions, EstimatorOptions, optional
        Which smears become matches; the robust estimator.
    rng : numpy.random.Generator or int, optional
        Source of randomness or its seed, 0 by default, so that a call repeats exactly.
    camera, shutter : Camera, RollingShutter, optional
        Intrinsics of this photograph, for its size; with them, of a rolling shutter, the geometry is that of
        an exposure of all rows at once, another one for each order in time (``geometry.reversed()``).
    detail : Detail
        ``Detail.RANKING`` reads fewer windows, unless a geometry is fitted.
    geometry : bool
        False asks for the blur alone, which is the same, and saves the fit of a geometry: neither F nor H.
    closer : bool
        With ``Detail.RANKING`` False takes the first look's word for what blurred the photograph, also where
        a closer look, which takes some times as long, might name another cause.

    Returns
    -------
    Estimate
        A photograph without a trustworthy F has a configuration with its reason, not an error.

    Raises
    ------
    ValueError
        If the picture has another shape, values or a size that cannot be used, or the camera is for pictures
        of another size.
    ImageError
        If the file of a path cannot be read.
    ModelError
        If the network cannot be used.

    Examples
    --------
    >>> import blur2view
    >>> result = blur2view.estimate("models/sample.jpg")
    >>> print(result.blur.kind)
    camera moved
    >>> result.geometry.F.shape
    (3, 3)
    """
    if camera is not None:
        require("camera", camera, Camera, CAMERAS)
    if isinstance(image, str | os.PathLike):
        picture = read_picture(image)
        image, camera = picture.pixels, camera or picture.exif.camera(picture.size)
    if network is None or isinstance(network, str | os.PathLike):
        network = SmearNetwork(network)
    require("network", network, SmearReader, "with predict, model_id and execution, or a path")
    image = as_photograph(image)
    height, width = image.shape[:2]
    if remedy := unusable_size(width, height):
        raise ValueError(f"a photograph of {width}x{height} pixels cannot be used; {remedy}")
    detail = Detail(detail)
    evidence, moving = _seen(image, network, detail, closer)
    grid, blur = evidence.grid, evidence.blur
    looked = is_named_by_looks(image.shape) or (detail is Detail.RANKING and not evidence.closest)
    if looked and (detail is Detail.GEOMETRY or (geometry and blur.kind.of_camera)):
        grid = network.predict(image)  # F fits some 48 smears of any kind
    matches = select_matches(grid, select)
    if blur.kind.of_camera:
        rng, knows_motion = np.random.default_rng(rng or 0), grid.kinds is not None
        two_view = (
            estimate_two_view(matches, options, rng, camera, shutter, moved=knows_motion)
            if geometry or not knows_motion  # without kinds the fit alone tells whether the camera moved
            else without_fit(matches)
        )
        evidence = replace(evidence, stood_still=two_view.stood_still)
        blur = evidence.measured_on(grid if detail is Detail.GEOMETRY else evidence.grid)
    else:
        two_view = without_motion(matches, blur)
    return Estimate(
        grid=grid,
        blur=blur,
        matches=matches,
        geometry=two_view,
        model_id=network.model_id,
        camera=camera,
        shutter=shutter if shutter is not None and shutter.readout_s else None,
        moving=moving,
        execution=network.execution,
    )


@one_thread
def segment(
    estimate: Estimate,
    image: AnyArray,
    rng: np.random.Generator | int | None = None,
    *,
    threshold: float = THRESHOLD,
) -> MotionMask:
    """Return which pixels of a photograph move by themselves, given the camera's own motion.

    Pixels about which the picture is smooth are unobservable. The shipped network reads the photograph anew
    if the estimate's smears are not those of a `SmearNetwork` in ``Detail.GEOMETRY``. Where the estimate has
    already found what moves in a photograph of at most 0.65 megapixels (``estimate.moving``), that is taken,
    and ``rng`` is not used.

    Parameters
    ----------
    estimate : Estimate
        The photograph's.
    image : ndarray of shape (H, W, 3) or (H, W)
        The photograph, as it was estimated.
    rng : numpy.random.Generator or int, optional
        Draws starts of the fit of the camera's motion; or its seed, 0 by default.
    threshold : float
        Probability above 0 and below 1 that the highest block of a part must reach. A lower one misses less
        of what moves, and marks more of what stands still.

    Returns
    -------
    MotionMask
        The label of every pixel, (H, W), and the moving parts; empty of parts where nothing moves.

    Raises
    ------
    ValueError
        If the image has another shape than the estimate, or the threshold is out of its range.

    Examples
    --------
    >>> import blur2view
    >>> image = blur2view.read_image("models/sample.jpg")
    >>> mask = blur2view.segment(blur2view.estimate("models/sample.jpg"), image)
    >>> mask.labels.shape
    (540, 960)
    >>> sorted(mask.shares)
    ['moving', 'static', 'unobservable']
    """
    image, grid = as_photograph(image), estimate.grid
    if image.shape[:2] != grid.shape:
        raise ValueError(f"expected the photograph of the estimate, {grid.shape}, got {image.shape}")
    if not 0 < threshold < 1:
        raise ValueError(f"the threshold must be a probability above 0 and below 1, got {threshold}")
    rng = np.random.default_rng(rng or 0)
    if grid.stride % STEP or (grid.stride // STEP).bit_count() != 1:  # of a look, too coarse for masks
        execution = estimate.execution
        grid = SmearNetwork(threads=execution.threads, providers=execution.providers).predict(image)
    moving = None if is_named_by_looks(image.shape) else estimate.moving
    return motion_mask(moving or moving_in(image, grid, rng, estimate.execution), image, threshold)


def _seen(
    image: AnyArray, network: SmearReader, detail: Detail, closer: bool
) -> tuple[Evidence, Moving | None]:
    """Return what a photograph shows of its blur, as much as is needed to name it, and what moves in it.

    A cheap look that leaves the name open is followed by a closer one, and that by a look for movers. Large
    photographs are looked at in the same way for every ``detail``, so that they have one name.
    """
    closest = Detail.CLOSER if is_named_by_looks(image.shape) else Detail.GEOMETRY
    first = detail if closest is Detail.GEOMETRY else Detail.RANKING
    grid = network.predict(image, detail=first)
    evidence = Evidence(grid=grid, closest=first is closest, nothing_seen=nothing_seen(image, grid))
    if not (evidence.closest or closer):
        return evidence, None
    if evidence.needed is Needed.WINDOWS:
        evidence = replace(evidence, grid=network.predict(image, detail=closest), closest=True)
    if evidence.needed is not Needed.MOVERS:
        return evidence, None
    moving = moving_in(image, evidence.grid, np.random.default_rng(0), network.execution)
    share = 0.0
    if moving.parts().any():
        copy = reduced(image, moving.block_px / BLOCK_PX)  # of every pixel of 24 megapixels it takes 0.5 GB
        share = motion_mask(replace(moving, block_px=BLOCK_PX), copy).shares["moving"]
    return replace(evidence, movers=moving.evidence(evidence.grid, share)), moving
