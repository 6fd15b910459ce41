"""Export trained mover networks to the ONNX file that the package ships.

``python -m tools.training.export_movers runs/movers/last.pt models/movers.onnx`` writes the averaged weights,
and checks the file against torch. Of several checkpoints it writes the mean, as the shipped file is of three.
"""

import torch

from blur2view.networks.mover_networks import BLUR, PLACE_PX
from blur2view.networks.spectra import STEP
from tools.arguments import Existing, Target, run
from tools.training.export import export_mover_network
from tools.training.movers import CELLS, PLACES, Movers


def main(checkpoints: list[Existing], target: Target) -> None:
    """Export the mean of the weights of one or more checkpoints of `tools.training.train_movers`."""
    states = [torch.load(path, map_location="cpu", weights_only=True) for path in checkpoints]
    weights, network = [state["average"] for state in states], Movers()
    network.load_state_dict(
        {name: torch.stack([one[name].double() for one in weights]).mean(0) for name in weights[0]}
    )
    facts = {"steps": [state["step"] for state in states], "seed": states[0]["seed"]}
    facts["pictures"] = [state["step"] * state["batch"] for state in states]
    export_mover_network(target, BLUR, network, (PLACES, CELLS), STEP // PLACE_PX, facts)


if __name__ == "__main__":
    run(main)
