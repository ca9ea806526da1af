"""A perceptron on the energies of differences, and two UNets; each trained on one way alone."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional
from torch.nn.utils import convert_conv2d_weight_memory_format

from benchmarks.warp_leak.twins import samples
from detect.learning.networks import PaperUNet, PlumeNet, Prediction
from geometry.arrays import FloatMap, GreyImage

PLUME_PX, STILL_PX, UNIT_PX = 0.06, 0.02, 0.1
THIN = (slice(3, None, 6),) * 2
SCALES_PX, WINDOWS_PX, FLOOR = (0.0, 0.8), (2.5, 7.0), 0.05
DIFFERENCES = [
    np.array(rows, np.float32)
    for rows in (
        [[1, -2, 1]], [[1], [-2], [1]], [[1, -1], [-1, 1]], [[1, -1]], [[1], [-1]],
        [[1, 0, 0], [0, -2, 0], [0, 0, 1]],
    )
]  # fmt: skip
HIDDEN, RATE, STEPS, BATCH = 48, 3e-3, 3000, 2048
UNETS: dict[str, Callable[[], nn.Module]] = {
    "lite": lambda: PlumeNet(width=16),
    "paper": lambda: PaperUNet(width=8),
}
UNET_RATE, UNET_BATCH, WARM_UP = 2e-3, 16, 100
CLEAR_PX, CLEAR_SHARE = 0.4, 0.4
SIZE_WEIGHT = 0.1
Ask = Callable[[GreyImage], tuple[FloatMap, FloatMap]]
"""Of an image: probability and size (px) of displacement, (H, W) each."""


def energies(image: GreyImage) -> FloatMap:
    """(H, W, F) logarithms of the energy of differences, by direction, scale and window."""
    planes, grey = [], image.astype(np.float32)
    for scale in SCALES_PX:
        smooth = cv2.GaussianBlur(grey, (0, 0), scale) if scale else grey
        for kernel in DIFFERENCES:
            energy = cv2.filter2D(smooth, cv2.CV_32F, kernel) ** 2
            planes += [cv2.GaussianBlur(energy, (0, 0), window) for window in WINDOWS_PX]
    return np.log(np.stack(planes, axis=-1) + FLOOR)


def loss_of(logit: Tensor, size: Tensor, size_px: Tensor, size_weight: float) -> Tensor:
    asked = (size_px > PLUME_PX) | (size_px < STILL_PX)
    plume = (size_px[asked] > PLUME_PX).float()
    mask = functional.binary_cross_entropy_with_logits(logit[asked], plume)
    return mask + size_weight * functional.mse_loss(size, size_px / UNIT_PX)


def perceptron(folder: Path) -> Ask:
    """Trained on the samples of a folder."""
    torch.manual_seed(0)
    images, sizes_px = samples(folder)
    inputs = torch.from_numpy(np.array([energies(image)[THIN] for image in images]))
    inputs, size_px = inputs.flatten(0, 2), torch.from_numpy(sizes_px[(..., *THIN)].ravel())
    mean, spread = inputs.mean(0), inputs.std(0)
    network = nn.Sequential(
        nn.Linear(inputs.shape[1], HIDDEN), nn.ReLU(), nn.Linear(HIDDEN, HIDDEN), nn.ReLU(),
        nn.Linear(HIDDEN, 2),
    )  # fmt: skip
    optimiser = torch.optim.AdamW(network.parameters(), lr=RATE)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, STEPS)
    for _ in range(STEPS):
        some = torch.randint(len(inputs), (BATCH,))
        logit, size = network((inputs[some] - mean) / spread).T
        loss = loss_of(logit, size, size_px[some], 1.0)
        optimiser.zero_grad()
        torch.autograd.backward(loss)
        optimiser.step()
        schedule.step()

    def ask(image: GreyImage) -> tuple[FloatMap, FloatMap]:
        with torch.inference_mode():
            says = network((torch.from_numpy(energies(image)) - mean) / spread)
        return torch.sigmoid(says[..., 0]).numpy(), (UNIT_PX * says[..., 1]).numpy()

    return ask


def unet(kind: str, folder: Path, steps: int) -> Ask:
    """Trained on the samples of a folder, or as it was before: FOLDER-KIND.pt."""
    torch.manual_seed(0)
    network = convert_conv2d_weight_memory_format(UNETS[kind](), torch.channels_last)
    weights = folder.with_name(f"{folder.name}-{kind}.pt")
    if weights.exists():
        network.load_state_dict(torch.load(weights, weights_only=True))
    else:
        images, size_px = map(torch.from_numpy, samples(folder))
        train(network, images, size_px, steps)
        torch.save(network.state_dict(), weights)
    network.eval()

    def ask(image: GreyImage) -> tuple[FloatMap, FloatMap]:
        with torch.inference_mode():
            logit, size = answers(network(torch.from_numpy(image[None, None] / np.float32(255))))
        return torch.sigmoid(logit[0]).numpy(), (UNIT_PX * size[0]).numpy()

    return ask


def train(network: nn.Module, images: Tensor, size_px: Tensor, steps: int) -> None:
    optimiser = torch.optim.AdamW(network.parameters(), lr=UNET_RATE)
    schedule = torch.optim.lr_scheduler.LambdaLR(
        optimiser, lambda k: min(1, (k + 1) / WARM_UP) * (0.5 + 0.5 * np.cos(np.pi * k / steps))
    )
    peak_px = size_px.amax((1, 2))
    clear = torch.nonzero((peak_px > CLEAR_PX) | (peak_px < STILL_PX)).ravel()
    for step in range(steps):
        among = clear if step < CLEAR_SHARE * steps else torch.arange(len(images))
        some, turns = among[torch.randint(len(among), (UNET_BATCH,))], int(torch.randint(8, ()))
        image, truth_px = (turn_maps(each[some], turns) for each in (images, size_px))
        with torch.autocast("cpu", torch.bfloat16):
            logit, size = answers(network(image[:, None].float() / 255))
        loss = loss_of(logit, size, truth_px, SIZE_WEIGHT)
        optimiser.zero_grad()
        torch.autograd.backward(loss)
        optimiser.step()
        schedule.step()
        if step % 100 == 99:
            print(f"step {step + 1} of {steps}: {loss.item():.3f}", flush=True)


def answers(says: Prediction) -> tuple[Tensor, Tensor]:
    """(N, H, W) logit, and size in units."""
    if says.logit is None:
        return says.displacement[:, 0].float(), says.displacement[:, 1].float()
    return says.logit[:, 0].float(), says.displacement[:, 0].float() / UNIT_PX


def turn_maps(maps: Tensor, turns: int) -> Tensor:
    """(N, H, W) by quarters, and mirrored from the fourth on."""
    maps = maps.rot90(turns % 4, (1, 2))
    return maps.flip(2) if turns > 3 else maps
