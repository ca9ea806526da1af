"""The networks: from an image to displacement, its uncertainty, and a mask."""

import math
from itertools import pairwise
from typing import NamedTuple, cast

import torch
from torch import Tensor, nn
from torch.nn import functional

from detect.learning.config import NetworkConfig

DISPLACEMENT_UNIT = 0.1
LOG_VARIANCE = (-14.0, 4.0)
INITIAL_LOG_VARIANCE, INITIAL_LOGIT = -6.0, -2.5
CONTRAST_FLOOR = 0.01
CELL_PX = 8
WIDENING = (1, 2, 4, 6)


class Prediction(NamedTuple):
    """The output of a network for N images; that of `PaperUNet` is the first alone.

    Attributes:
        displacement: (N, 2, H, W) px, x right and y down.
        log_variance: (N, 1, H, W), of either component, log px^2.
        logit: (N, 1, H, W), of the mask.
    """

    displacement: Tensor
    log_variance: Tensor | None = None
    logit: Tensor | None = None


def build_network(config: NetworkConfig) -> nn.Module:
    """The network that a config names, with fresh weights."""
    if config.kind == "paper":
        return PaperUNet(channels=config.channels, width=config.width)
    return PlumeNet(channels=config.channels, width=config.width, normalise=config.normalise)


class PlumeNet(nn.Module):
    """A small UNet at half resolution and below.

    An image is read twice, as it is and with its local mean and contrast taken out; both within
    the network, so that whoever runs it need not know. Features are read by 6 x 6 px: the same as
    3 x 3 of their four phases, without moving every value first.

    Args:
        channels: Of the input.
        width: Channels at half resolution; 16 for speed, 24 for accuracy.
        normalise: Whether the input is an image, to be normalised, or features already scaled.
    """

    stride = 16
    receptive_px = 112

    def __init__(self, *, channels: int = 1, width: int = 16, normalise: bool = True) -> None:
        super().__init__()
        self.normalise = normalise
        sizes = [_round_up_to_16(width * factor) for factor in WIDENING]
        if normalise:
            self.stem = _convolution_block(8 * channels, sizes[0])
        else:
            self.stem = _convolution_block(channels, sizes[0], stride=2, side=6)
        self.fine = _convolution_block(sizes[0], sizes[0])
        steps = list(pairwise(sizes))
        self.down = nn.ModuleList(
            nn.Sequential(_convolution_block(a, b, stride=2), _convolution_block(b, b))
            for a, b in steps
        )
        self.narrow = nn.ModuleList(nn.Conv2d(b, a, 1) for a, b in reversed(steps))
        self.up = nn.ModuleList(
            nn.Sequential(_convolution_block(a, a), _convolution_block(a, a))
            for a, _ in reversed(steps)
        )
        self.head = nn.Conv2d(sizes[0], 4 * 4, 1)
        nn.init.zeros_(self.head.weight)
        bias = torch.tensor([0.0, 0.0, INITIAL_LOG_VARIANCE, INITIAL_LOGIT])
        self.head.bias = nn.Parameter(bias.repeat_interleave(4))

    def forward(self, image: Tensor) -> Prediction:
        """Predicts for (N, C, H, W); H and W are multiples of `stride`."""
        with torch.autocast(image.device.type, enabled=False):
            x = self.stem(self._normalised_planes(image) if self.normalise else image)
        x = self.fine(x)
        skips = []
        for down in self.down:
            skips.append(x)
            x = down(x)
        for narrow, up, skip in zip(self.narrow, self.up, reversed(skips), strict=True):
            x = up(functional.interpolate(narrow(x), scale_factor=2, mode="nearest") + skip)
        with torch.autocast(image.device.type, enabled=False):
            maps = functional.pixel_shuffle(self.head(x.float()), 2)
        return Prediction(
            displacement=DISPLACEMENT_UNIT * maps[:, :2],
            log_variance=maps[:, 2:3].clamp(*LOG_VARIANCE),
            logit=maps[:, 3:],
        )

    def _normalised_planes(self, image: Tensor) -> Tensor:
        """The image at half resolution, its four phases as channels, plain and normalised."""
        plain = functional.pixel_unshuffle(image, 2)
        mean = _cell_means(image)
        spread = (_cell_means(image * image) - mean * mean).clamp(min=0).sqrt() + CONTRAST_FLOOR
        local = torch.cat([mean, spread], 1)
        local = functional.interpolate(
            local, scale_factor=CELL_PX // 2, mode="bilinear", align_corners=False
        )
        mean, spread = (part.repeat_interleave(4, 1) for part in local.chunk(2, 1))
        return torch.cat([plain - 0.5, (plain - mean) / spread], 1)


class PaperUNet(nn.Module):
    """The single-frame network of the DYBS paper (section III): flow alone.

    The UNet's four poolings and skips, convolutions at the bottleneck, BatchNorm after each
    nonlinearity. The paper does not say the width; the UNet's own is 64.

    Args:
        channels: Of the input: 1 as published, 3 for its outlook.
        width: Channels at full resolution; doubled at each pooling.
    """

    stride = 16
    receptive_px = 112

    def __init__(self, *, channels: int = 1, width: int = 64) -> None:
        super().__init__()
        sizes = [width << level for level in range(5)]
        self.down = nn.ModuleList(
            _published_block(a, b) for a, b in zip([channels, *sizes], sizes, strict=False)
        )
        self.widen = nn.ModuleList(
            nn.ConvTranspose2d(2 * size, size, 2, stride=2) for size in reversed(sizes[:-1])
        )
        self.up = nn.ModuleList(_published_block(2 * size, size) for size in reversed(sizes[:-1]))
        self.head = nn.Conv2d(width, 2, 1)

    def forward(self, image: Tensor) -> Prediction:
        """Predicts for (N, C, H, W) in [0, 1]; H and W are multiples of `stride`."""
        x, skips = self.down[0](image), []
        for down in list(self.down)[1:]:
            skips.append(x)
            x = down(functional.max_pool2d(x, 2))
        for widen, up, skip in zip(self.widen, self.up, reversed(skips), strict=True):
            x = up(torch.cat([skip, widen(x)], 1))
        return Prediction(displacement=cast(Tensor, self.head(x)).float())


def _convolution_block(a: int, b: int, stride: int = 1, side: int = 3) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(a, b, side, stride=stride, padding=(side - 1) // 2, bias=False),
        nn.BatchNorm2d(b),
        nn.ReLU(inplace=True),
    )


def _published_block(a: int, b: int) -> nn.Sequential:
    layers: list[nn.Module] = []
    for size in (a, b):
        layers += [nn.Conv2d(size, b, 3, padding=1), nn.ReLU(inplace=True), nn.BatchNorm2d(b)]
    return nn.Sequential(*layers)


def _cell_means(image: Tensor) -> Tensor:
    """Means of 3 x 3 cells of 8 px, one for each cell."""
    cells = functional.avg_pool2d(image, CELL_PX)
    return functional.avg_pool2d(cells, 3, stride=1, padding=1, count_include_pad=False)


def _round_up_to_16(size: float) -> int:
    """The next multiple of 16, which a processor's widest registers hold."""
    return 16 * math.ceil(size / 16)
