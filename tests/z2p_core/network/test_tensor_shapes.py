"""Names and shapes of tensors from the configuration match the network that is built."""

from math import prod

import pytest

from z2p_core.config import NetworkConfig
from z2p_core.network.tensor_shapes import MAX_WEIGHTS, network_config_fault, network_shapes
from z2p_core.network.unet import build_network

CONFIGS = [
    NetworkConfig(),
    NetworkConfig(widths=(8, 12), unshuffle=2, refine=0, mapping=5),
    NetworkConfig(widths=(8, 12, 16, 20, 24), unshuffle=4, fine=6, mapping=7),
    NetworkConfig(widths=(8, 12, 16), unshuffle=8, conditioning="input", fine=4),
    NetworkConfig(kind="adain_unet", widths=(4, 6, 8), unshuffle=1, mapping=9),
]


@pytest.mark.parametrize("config", CONFIGS, ids=range(len(CONFIGS)))
@pytest.mark.parametrize("channels", [(3, 0, 1), (21, 40, 7)])
def test_names_and_shapes_are_those_of_the_network(config, channels):
    network = build_network(config, *channels)
    assert network_shapes(config, *channels) == {name: tuple(one.shape) for name, one in network.state_dict().items()}


def test_absurdly_large_networks_are_refused_unbuilt():
    for config in (NetworkConfig(widths=(10**9, 10**9)), NetworkConfig(mapping=10**6)):
        assert sum(map(prod, network_shapes(config, 3, 0, 7).values())) > MAX_WEIGHTS
        assert "at most 500,000,000 weights" in network_config_fault(config)
        with pytest.raises(ValueError, match="at most"):
            build_network(config, 3, 0, 7)
