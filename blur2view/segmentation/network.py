"""The motion segmentation network: a checked ONNX file, run on a photograph of moderate size."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.errors import ModelError
from blur2view.networks.model_file import open_session, session_errors, shipped_file, usable_cores
from blur2view.networks.smear_network import SmearNetwork, check_image
from blur2view.networks.tiles import reflected
from blur2view.pipeline import Estimate
from blur2view.segmentation.features import CHANNELS, motion_features
from blur2view.segmentation.reduced import reduced_estimate, reduced_image, reduced_shape
from blur2view.segmentation.score import motion_score
from blur2view.smears.field import upsample_grid
from blur2view.smears.matches import STRIDE

SHIPPED, SHIPPED_SMEARS = "motion.onnx", "local_smear.onnx"
FORMAT = "motion-1"
INPUTS, OUTPUTS = {"image": 3, "features": CHANNELS}, {"moving": 1}
"""Names and channels, all (N, C, H, W)."""
REMEDY = "export one with tools/training/export_motion.py or install blur2view again for the shipped one"
LONGEST_SIDES = 640, 320
"""The network looks at copies of the photograph of at most these sizes; their logits are averaged."""


@dataclass(frozen=True, kw_only=True)
class MotionInfo:
    """What the file says of itself: name of the weights, cell size and granularity in pixels, licence."""

    model_id: str
    stride: int
    multiple_of: int
    license: str = ""


class MotionNetwork:
    """A loaded motion segmentation network; load once, use for many photographs.

    Parameters
    ----------
    path : path-like, optional
        An ONNX file written by ``tools/training/export_motion.py``; the shipped one by default.
    smears : SmearNetwork, optional
        A network that gives smears in cells of 4 px, which masks are made of instead of the estimate's own:
        those are read in windows of 96 px, which small movers do not fill. With the shipped network the
        shipped one.
    threads : int, optional
        Threads of one inference; all cores this process may use by default.

    Raises
    ------
    ModelError
        If the file is missing, not ONNX, or not a network of this format.
    """

    def __init__(
        self,
        path: str | os.PathLike[str] | None = None,
        smears: SmearNetwork | None = None,
        *,
        threads: int | None = None,
    ) -> None:
        self.path = shipped_file(SHIPPED) if path is None else Path(path)
        if path is None and smears is None:
            smears = SmearNetwork(shipped_file(SHIPPED_SMEARS), threads=threads)
        self.smears = smears
        self._session = open_session(self.path, threads or usable_cores(), REMEDY)
        self.info = read_info(self.path, self._session)

    @classmethod
    def beside(cls, smears: SmearNetwork, *, threads: int | None = None) -> MotionNetwork:
        """Return the shipped network with these smears if they come in cells of 4 px, else with its own."""
        return cls(smears=smears if smears.info.stride == STRIDE else None, threads=threads)

    def with_local_smears(self, found: Estimate, image: NDArray[np.float32]) -> Estimate:
        """Return the estimate with the smears that masks are made of."""
        return found if self.smears is None else replace(found, field=self.smears.predict(image))

    def probability(self, found: Estimate, image: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return how probably every pixel moves by itself.

        Parameters
        ----------
        found : Estimate
            Of the photograph.
        image : ndarray of shape (H, W, 3), float32
            The photograph, sRGB-coded RGB in [0, 1].

        Returns
        -------
        ndarray of shape (H, W), float32
            Interpolated between the cells of both copies.

        Raises
        ------
        ValueError
            If the photograph is not of the estimate's size, float32 and in [0, 1].
        ModelError
            If the network cannot be run or its output is not what its format promises.
        """
        check_image(image)
        if image.shape[:2] != found.field.shape:
            raise ValueError(f"expected an image of shape {(*found.field.shape, 3)}, got {image.shape}")
        sides = {reduced_shape(image.shape, side): side for side in LONGEST_SIDES}.values()
        logits = np.mean([self._at_size(found, image, side) for side in sides], axis=0, dtype=np.float32)
        return np.asarray(1 / (1 + np.exp(np.minimum(-logits, 80))), np.float32)  # exp(89) overflows

    def _at_size(self, found: Estimate, image: NDArray[np.float32], longest: int) -> NDArray[np.float32]:
        """Return the logits (H, W) that the network finds in a copy of the photograph, interpolated."""
        height, width = reduced_shape(image.shape, longest)
        covered = upsample_grid(self.cells(found, image, longest)[..., None], self.info.stride)
        within = covered[:height, :width, 0]
        pixels = cv2.resize(within, image.shape[1::-1], interpolation=cv2.INTER_LINEAR)
        return np.asarray(pixels, np.float32).reshape(image.shape[:2])

    def cells(
        self, found: Estimate, image: NDArray[np.float32], longest: int = LONGEST_SIDES[0]
    ) -> NDArray[np.float32]:
        """Return the logits (h, w) of cells of ``info.stride`` pixels of a photograph made smaller.

        The last cells may reach beyond it.
        """
        small = reduced_image(image, longest)
        stride, step = self.info.stride, self.info.multiple_of
        rows, columns = (range(-(-side // step) * step) for side in small.shape[:2])
        estimate = reduced_estimate(found, (small.shape[0], small.shape[1]))
        features = motion_features(estimate, motion_score(estimate))
        shape = features.shape[1:]
        missing = [(0, len(span) // stride - n) for span, n in zip((rows, columns), shape, strict=True)]
        padded = np.pad(features, [(0, 0), *missing], mode="edge")
        planes = np.ascontiguousarray(reflected(small, rows, columns).transpose(2, 0, 1)[None])
        return self._run(planes, padded[None])[: shape[0], : shape[1]]

    def _run(self, image: NDArray[np.float32], features: NDArray[np.float32]) -> NDArray[np.float32]:
        """Run the network on one picture (1, 3, H, W); logits (h, w)."""
        try:
            (logits,) = self._session.run(["moving"], {"image": image, "features": features})
        except session_errors():
            size = f"{image.shape[3]}x{image.shape[2]} pixels"
            raise ModelError(f"{self.path}: cannot be run on {size}") from None
        if logits.shape != (1, 1, *features.shape[2:]) or not np.isfinite(logits).all():
            raise ModelError(f"{self.path}: gives other values than its format promises")
        return np.asarray(logits[0, 0], np.float32)


def read_info(path: Path, session: Any) -> MotionInfo:
    """Return the metadata of a network of this format; refuse any other."""
    try:
        metadata: dict[str, str] = session.get_modelmeta().custom_metadata_map
        inputs, outputs = (
            {node.name: node.shape[1] if len(node.shape) == 4 else None for node in nodes}
            for nodes in (session.get_inputs(), session.get_outputs())
        )
        if metadata.get("blur2view_format") != FORMAT or (inputs, outputs) != (INPUTS, OUTPUTS):
            raise ModelError(f"{path}: is not a motion segmentation network of format {FORMAT}; {REMEDY}")
        info = MotionInfo(
            model_id=metadata["model_id"],
            stride=int(metadata["stride"]),
            multiple_of=int(metadata["multiple_of"]),
            license=metadata.get("license", ""),
        )
    except (UnicodeDecodeError, KeyError, ValueError) as error:
        raise ModelError(f"{path}: has damaged metadata ({error}); {REMEDY}") from None
    if info.stride != STRIDE or info.multiple_of < 1 or info.multiple_of % info.stride:
        raise ModelError(f"{path}: has damaged metadata (stride, multiple_of); {REMEDY}")
    return info
