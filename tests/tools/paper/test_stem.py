"""What the network's fixed features see: lags that tell lengths, and no farther than a training crop."""

import torch

from tools.paper.networks import StemUNet


def test_the_network_sees_no_farther_than_a_training_crop() -> None:
    torch.manual_seed(0)
    network = StemUNet().eval()
    image = torch.rand(1, 3, 384, 384)
    changed = image.clone()
    changed[..., :32] = 0.1  # 160 px left of the middle
    with torch.no_grad():
        difference = (network(image) - network(changed)).abs()[0, :, 48, :]
    assert difference[:, 48].max() < 1e-6
    assert difference[:, 4].max() > 1e-3
