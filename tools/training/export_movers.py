"""Export a trained mover network to the ONNX file that the package ships.

``python -m tools.training.export_movers runs/movers/last.pt models/movers.onnx`` writes the averaged weights,
and checks the file against torch. Of several checkpoints of one training, as after each of its cycles, their
mean: it ranks as well, and errs less where nothing moves.
"""

import torch

from blur2view.movers.network import INPUTS, OUTPUT
from tools.arguments import Existing, Target, run
from tools.training.export import export
from tools.training.movers import CELLS, PLACES, Movers


def main(checkpoints: list[Existing], target: Target) -> None:
    """Export the mean of the weights of one or more checkpoints."""
    states = [torch.load(path, map_location="cpu", weights_only=True) for path in checkpoints]
    network = Movers().eval()
    weights = [state["average"] for state in states]
    network.load_state_dict(
        {name: torch.stack([one[name].double() for one in weights]).mean(0) for name in weights[0]}
    )
    facts = {
        "steps": [state["step"] for state in states],
        "pictures": [state["step"] * state["batch"] for state in states],
        "seed": states[0]["seed"],
    }
    shown, odd = (
        (torch.rand(1, PLACES, 8 * h, 8 * w), torch.rand(1, CELLS, h, w)) for h, w in ((12, 16), (7, 13))
    )
    export(
        target,
        network,
        dict(zip(INPUTS, shown, strict=True)),
        [OUTPUT],
        {name: {2: "rows", 3: "columns"} for name in (*INPUTS, OUTPUT)},
        odd,
        "movers",
        facts,
    )


if __name__ == "__main__":
    run(main)
