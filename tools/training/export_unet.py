"""Export a trained U-Net to the ONNX file that the package ships.

``python -m tools.training.export_unet runs/unet/weights.pt models/unet.onnx`` stores its averaged weights in
half precision, and checks the file against torch.
"""

import torch

from blur2view.networks.mover_networks import CELL_VALUES, UNET
from blur2view.networks.spectra import STEP
from tools.arguments import Existing, Target, run
from tools.training.export import export_mover_network
from tools.training.unet import Exported, UNet


def main(weights: Existing, target: Target) -> None:
    """Export the weights that `tools.training.train_unet` wrote."""
    stored = torch.load(weights, map_location="cpu", weights_only=True)
    network = UNet()
    network.load_state_dict({k: v.float() if v.is_floating_point() else v for k, v in stored["unet"].items()})
    facts = {"steps": stored["step"]}
    export_mover_network(target, UNET, Exported(network), (3, CELL_VALUES), STEP, facts, half=True)


if __name__ == "__main__":
    run(main)
