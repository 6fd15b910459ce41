"""One photograph's file to its estimate: the step that all commands share."""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blur2view.exif import read_exif
from blur2view.image import read_image
from blur2view.pipeline import Estimate, estimate
from blur2view.predict import SmearNetwork
from blur2view.results import Run, document


@dataclass(frozen=True, kw_only=True, eq=False)
class FileEstimate:
    """What was found in one file.

    Parameters
    ----------
    path : Path
        As the user named it.
    image : ndarray of shape (H, W, 3), float32
        The photograph, upright.
    found : Estimate
        The smears and the geometry.
    facts : dict
        The JSON document of `results.document`.
    """

    path: Path
    image: NDArray[np.float32]
    found: Estimate
    facts: dict[str, Any]


def estimate_file(path: Path, network: SmearNetwork, run: Run) -> FileEstimate:
    """Read a photograph and estimate its geometry, as ``blur2view estimate`` does.

    Parameters
    ----------
    path : Path
    network : SmearNetwork
    run : Run
        What was asked for. Each photograph has a generator of its own, so that its result does not depend
        on those before it.

    Raises
    ------
    ImageError, CameraError, ModelError
        If the file cannot be read, its camera not be had or the network not be run.
    """
    start = time.perf_counter()
    image = read_image(path)
    read_s = time.perf_counter() - start
    rng = np.random.default_rng(run.seed)
    exif = read_exif(path)
    camera = run.intrinsics.of(path, (image.shape[1], image.shape[0]), exif)
    found = estimate(image, network=network, select=run.select, options=run.options, rng=rng, camera=camera)
    facts = document(path, found.field.shape, found, run, read_s, run.exposure_s or exif.exposure_s)
    return FileEstimate(path=path, image=image, found=found, facts=facts)
