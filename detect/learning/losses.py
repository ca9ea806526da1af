"""What training minimises."""

import torch
from torch import Tensor
from torch.nn import functional

from detect.learning.config import LossConfig
from detect.learning.networks import DISPLACEMENT_UNIT, Prediction

CHARBONNIER_KNEE = 0.3
BETA = 0.5


def mask_labels(truth: Tensor, limits_px: Tensor) -> tuple[Tensor, Tensor]:
    """What the mask should say, and where it is asked.

    Args:
        truth: (N, 2, H, W) px.
        limits_px: (N, 2) |w| above the first is plume, below the second none.

    Returns:
        (N, 1, H, W) float, 1 where there is plume; (N, 1, H, W) bool.
    """
    size = truth.square().sum(1, keepdim=True).sqrt()
    positive_px, negative_px = limits_px.reshape(-1, 2, 1, 1, 1).unbind(1)
    plume = size > positive_px
    return plume.float(), plume | (size < negative_px)


def total_loss(
    prediction: Prediction, truth: Tensor, weights: LossConfig, limits_px: Tensor
) -> Tensor:
    """The weighted sum of the losses that have a weight."""
    error = (prediction.displacement - truth) / DISPLACEMENT_UNIT
    loss = error.new_zeros(())
    if weights.charbonnier:
        loss = loss + weights.charbonnier * charbonnier_loss(error)
    if weights.squared:
        loss = loss + weights.squared * error.square().mean()
    if weights.mask and prediction.logit is not None:
        plume, asked = mask_labels(truth, limits_px)
        loss = loss + weights.mask * masked_cross_entropy(prediction.logit, plume, asked)
    if weights.likelihood and prediction.log_variance is not None:
        loss = loss + weights.likelihood * beta_nll(error, prediction.log_variance)
    return loss


def charbonnier_loss(error: Tensor) -> Tensor:
    """Squared where small, straight where large; (N, 2, ...) in units of the displacement."""
    return ((error.square().sum(1) + CHARBONNIER_KNEE**2).sqrt() - CHARBONNIER_KNEE).mean()


def masked_cross_entropy(logit: Tensor, plume: Tensor, asked: Tensor) -> Tensor:
    """Binary cross-entropy, mean over where it is asked."""
    each = functional.binary_cross_entropy_with_logits(logit, plume, reduction="none")
    return (each * asked).sum() / asked.sum().clamp(min=1)


def beta_nll(error: Tensor, log_variance: Tensor) -> Tensor:
    """Gaussian negative log-likelihood, weighted by variance^beta.

    The weight keeps what is hard from being given up (Seitzer et al., On the Pitfalls of
    Heteroscedastic Uncertainty Estimation, ICLR 2022, eq. 5).

    Args:
        error: (N, 2, H, W) in units of the displacement.
        log_variance: (N, 1, H, W), log px^2.
    """
    in_units = log_variance - 2 * torch.log(log_variance.new_tensor(DISPLACEMENT_UNIT))
    each = (error.square() * torch.exp(-in_units) + in_units) / 2
    return (each * torch.exp(BETA * in_units.detach())).mean()
