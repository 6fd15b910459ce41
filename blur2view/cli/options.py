"""From the options of the command line to the dataclasses that check them."""

import argparse
import math
from collections.abc import Callable

from blur2view.camera.intrinsics import Intrinsics
from blur2view.colmap.cameras import stored_camera
from blur2view.errors import CameraError
from blur2view.geometry.rolling_shutter import RollingShutter
from blur2view.pipeline import Run
from blur2view.smears.sampling import SelectOptions
from blur2view.two_view.options import EstimatorOptions

SHORTEST_S = 1e-9  # no shutter and no flash is as short


def read_run(options: argparse.Namespace, usage_error: Callable[[str], object]) -> Run:
    """Return the options as dataclasses; a wrong value is a usage error."""
    exposure_s, readout_s = getattr(options, "exposure", None), getattr(options, "readout", None)
    if options.resume and options.command in ("estimate", "segment") and options.output is None:
        usage_error("--resume goes on with results in a folder; name it with -o")
    try:
        if options.seed < 0:
            raise ValueError(f"seed must not be negative, got {options.seed}")
        if exposure_s is not None and not SHORTEST_S < exposure_s < math.inf:
            raise ValueError(f"exposure must be above {SHORTEST_S:g} s and finite, got {exposure_s}")
        if readout_s is not None and options.focal is None and options.camera is None:
            raise ValueError("--readout corrects the pose of --focal or --camera only; add one")
        if exposure_s is not None and options.focal is None and options.camera is None:
            raise ValueError("--exposure gives an angular velocity with --focal or --camera only; add one")
        if readout_s is not None:
            RollingShutter(readout_s=readout_s, exposure_s=exposure_s or 1.0)  # which checks it
        camera = stored_camera(options.camera or "") or options.camera
        intrinsics = Intrinsics(focal_px=options.focal, camera=camera)
        if options.dask is not None and intrinsics.in_database:
            raise ValueError(
                "the workers of --dask see no database; write its camera out: MODEL WIDTH HEIGHT ..."
            )
        return Run(
            select=SelectOptions(beta=options.beta),
            options=EstimatorOptions(max_error_px=options.max_error),
            seed=options.seed,
            intrinsics=intrinsics,
            exposure_s=exposure_s,
            readout_s=readout_s,
            max_memory_gib=options.max_memory,
        )
    except (ValueError, CameraError) as error:
        usage_error(str(error))
        raise
