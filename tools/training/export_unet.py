"""Export a trained U-Net to the ONNX file that the package ships.

``python -m tools.training.export_unet runs/unet/weights.pt models/unet.onnx`` stores its averaged weights in
half precision, and checks the file against torch.
"""

import torch

from blur2view.networks.mover_networks import CELL_VALUES, UNET
from blur2view.networks.spectra import STEP
from tools.arguments import Existing, Target, run
from tools.training.export import export
from tools.training.unet import Exported, UNet


def main(weights: Existing, target: Target) -> None:
    """Export the weights that `tools.training.train_unet` wrote."""
    stored = torch.load(weights, map_location="cpu", weights_only=True)
    network = UNet()
    network.load_state_dict({k: v.float() if v.is_floating_point() else v for k, v in stored["unet"].items()})
    shown, odd = (
        (torch.rand(1, 3, STEP * h, STEP * w), torch.rand(1, CELL_VALUES, h, w)) for h, w in ((8, 12), (5, 7))
    )
    export(
        target,
        Exported(network),
        dict(zip(UNET.inputs, shown, strict=True)),
        UNET.outputs,
        {name: {2: "rows", 3: "columns"} for name in UNET.inputs}
        | {UNET.outputs[0]: {1: "rows", 2: "columns"}},
        odd,
        "unet",
        {"steps": stored["step"]},
        {"blur2view_format": UNET.version},
        half=True,
    )


if __name__ == "__main__":
    run(main)
