"""Export a trained reader to the ONNX file that the package ships.

``python -m tools.training.export_reader runs/reader/last.pt models/smear.onnx`` writes the averaged weights
with the metadata that :mod:`blur2view.networks.model_file` reads, and checks the file against torch on a
rendered picture.
"""

import numpy as np
import torch
from torch import Tensor, nn

from blur2view.errors import ModelError
from blur2view.networks.brightness import BRIGHT
from blur2view.networks.model_file import FORMAT, INPUTS, OUTPUTS
from blur2view.networks.spectra import STEP, polar_cepstra, power_spectra, windows_of
from blur2view.smears.likelihood import DIRECTIONS
from tools.arguments import Existing, Target, run
from tools.rendering.render import RenderOptions, render
from tools.rendering.sensor import photograph
from tools.training.export import export
from tools.training.reader import Circular, Reader, clipped_shares
from tools.training.train_reader import load_average

CONVENTION = (
    "one octave of a photograph; inputs: grey (1,1,H,W) float32, sRGB-coded luma, 0 to 1, H and W "
    "multiples of 32 and at least 64; cepstra (1,H/32,W/32,32,45) and scales (1,H/32,W/32,3) of its windows "
    "of 96 px as blur2view.networks.spectra gives them; "
    "coarser (1,H/32,W/32,32,C): features of the octave half the size, each cell repeated 2 x 2, or zeros; "
    "outputs: logits (1,H/32,W/32,32,20) over direction (180 k / 32 degrees) and length (shorter, 2 px "
    "and up, four an octave, longer), radii (1,H/32,W/32,20) over radius out of focus (smaller, 0.7 px and "
    "up, four an octave, larger), kinds (1,H/32,W/32,5): sharp, out of focus, smeared, both, cannot tell; "
    "features (1,H/32,W/32,32,C); cell j is centred at pixel 32*j + 15.5"
)
PROPERTIES = {
    "blur2view_format": FORMAT,
    "stride": str(STEP),
    "multiple_of": str(STEP),
    "brightness": str(BRIGHT),
    "convention": CONVENTION,
}


class ExportedOctave(nn.Module):
    """What the ONNX file computes: all that is learned, for one octave."""

    def __init__(self, network: Reader) -> None:
        super().__init__()
        self.network = network
        for layer in network.modules():
            if isinstance(layer, Circular):
                layer.store_matrix()

    def forward(self, grey: Tensor, *inputs: Tensor) -> tuple[Tensor, ...]:
        """Compute the outputs ``logits``, ``radii``, ``kinds`` and ``features``."""
        cepstra, scales, coarser = inputs
        scalars = torch.cat([scales, clipped_shares(grey)], -1)
        return self.network.octave(self.network.windows(cepstra, scalars), coarser)


def sample_picture() -> Tensor:
    """Return a rendered grey picture (1, 1, 256, 320) in [0, 1]."""
    scene = render(7, RenderOptions(size=(320, 256)))
    image = photograph(np.random.default_rng(7), scene.linear).astype(np.float32) / 255
    return torch.from_numpy(np.ascontiguousarray(image.mean(-1)[None, None]))


def inputs_of(network: Reader, grey: Tensor) -> dict[str, Tensor]:
    """Return the inputs of the octave of a picture (1, 1, H, W), its smaller one's features at random."""
    read = polar_cepstra(power_spectra(windows_of(grey[0, 0].numpy())))
    cepstra, scales = (torch.from_numpy(one)[None] for one in read)
    coarser = torch.rand(*scales.shape[:3], DIRECTIONS, network.options.region)
    return dict(zip(INPUTS, (grey, cepstra, scales, coarser), strict=True))


def main(checkpoint: Existing, target: Target) -> None:
    """Export one checkpoint; the weights keep their names, so that a training can start from the file.

    ONNX Runtime rearranges them when it loads it.
    """
    network, state = load_average(checkpoint)
    options, steps = state["options"], state["step"]
    facts = {"seed": options["seed"], "steps": steps, "pictures": steps * options["batch"]}
    facts["figures"] = state["figures"]
    cells, grey = {1: "rows", 2: "columns"}, sample_picture()
    shown = inputs_of(network, grey[..., :128, :192].contiguous())
    try:
        export(
            target,
            ExportedOctave(network),
            shown,
            OUTPUTS,
            {name: cells for name in (*INPUTS, *OUTPUTS)} | {"grey": {2: "height", 3: "width"}},
            list(inputs_of(network, grey).values()),
            "smear",
            facts,
            PROPERTIES,
            eight_bits=True,
        )
    except ModelError as error:
        raise SystemExit(str(error)) from None


if __name__ == "__main__":
    run(main)
