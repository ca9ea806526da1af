"""A network with the weights of an ONNX file, to train it further."""

from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
import onnx
import torch
from onnx import numpy_helper
from torch import Tensor, nn

from detect.learning.config import NetworkConfig
from detect.learning.networks import build_network
from detect.network import Network
from geometry.errors import BadInputError

WIDTHS = range(8, 65, 8)
PREFIX, FOLDED = "network.", ".weight_bias"


@dataclass(frozen=True, kw_only=True)
class StoredNetwork:
    """What an ONNX file holds.

    Attributes:
        name: By its metadata.
        config: What kind of network it is.
        network: It, in evaluation mode.
    """

    name: str
    config: NetworkConfig
    network: nn.Module


def read_network(path: Path) -> StoredNetwork:
    """The network that `detect.learning.export` wrote, fp32.

    The file has every BatchNorm folded into its convolution, so each one comes back as a mere
    bias; `revive_norms` makes it one again.

    Raises:
        BadInputError: The file is not a network of ours, is of another design, or is quantised.
    """
    whole = Network(path)
    stored = {
        tensor.name.removeprefix(PREFIX): torch.from_numpy(numpy_helper.to_array(tensor).copy())
        for tensor in onnx.load(path).graph.initializer
        if tensor.name.startswith(PREFIX)
    }
    for width, normalise in product(WIDTHS, (True, False)):
        config = NetworkConfig(channels=whole.channels, width=width, normalise=normalise)
        network = build_network(config).eval()
        state = _unfold_norms(network, stored)
        if all(state[name].shape == there.shape for name, there in network.state_dict().items()):
            network.load_state_dict(state)
            return StoredNetwork(name=whole.name, config=config, network=network)
    raise BadInputError(f"{path}: its weights are not those of an fp32 network of this version")


def revive_norms(network: nn.Module, images: Tensor) -> None:
    """Gives every BatchNorm the statistics it has on (N, C, H, W) images.

    In evaluation mode the output of the network is what it was; in training mode nearly so.
    """
    norms = [module for module in network.modules() if isinstance(module, nn.BatchNorm2d)]
    hooks = [norm.register_forward_hook(_revive_norm) for norm in norms]
    with torch.no_grad():
        network.eval()(images)
    for hook in hooks:
        hook.remove()


def _revive_norm(norm: nn.Module, inputs: tuple[Tensor], _: Tensor) -> None:
    assert isinstance(norm, nn.BatchNorm2d)
    assert norm.running_mean is not None
    assert norm.running_var is not None
    mean, variance = inputs[0].mean((0, 2, 3)), inputs[0].var((0, 2, 3))
    slope = norm.weight / (norm.running_var + norm.eps).sqrt()
    norm.bias.add_(slope * (mean - norm.running_mean))
    norm.weight.copy_(slope * (variance + norm.eps).sqrt())
    norm.running_mean.copy_(mean)
    norm.running_var.copy_(variance)


def _unfold_norms(network: nn.Module, stored: dict[str, Tensor]) -> dict[str, Tensor]:
    """The state of `network` by what is stored; empty tensors where nothing is."""
    state = {name: stored.get(name, torch.empty(0)) for name in network.state_dict()}
    for path, module in network.named_modules():
        if isinstance(module, nn.BatchNorm2d):
            parent, _, place = path.rpartition(".")
            bias = stored.get(f"{parent}.{int(place) - 1}{FOLDED}", torch.empty(0))
            unit = torch.ones_like(bias)
            state |= {
                f"{path}.weight": unit,
                f"{path}.bias": bias,
                f"{path}.running_mean": torch.zeros_like(bias),
                f"{path}.running_var": unit - module.eps,
                f"{path}.num_batches_tracked": torch.from_numpy(np.array(0)),
            }
    return state
