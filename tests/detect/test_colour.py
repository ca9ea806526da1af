"""The paper's outlook, three channels, from samples to the runtime."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch")

import torch

from detect.dybs.estimator import SingleFrameEstimator
from detect.learning.config import TrainConfig
from detect.learning.export import export_checkpoint
from detect.learning.trainer import LAST, train_network
from detect.network import Network
from detect.synthesis import FAMILIES, Shard
from detect.synthesis.dataset import SCHEMA, write_index

SAMPLES, SIDE = 12, 32


def colour_samples(folder: Path) -> Shard:
    """Waves whose green is displaced, and whose red and blue are not."""
    rng = np.random.default_rng(0)
    x = np.broadcast_to(np.arange(SIDE, dtype=np.float32), (SAMPLES, SIDE, SIDE))
    w = np.zeros((SAMPLES, SIDE, SIDE, 2), np.float16)
    w[::2, 8:24, 8:24, 0] = 0.8
    waves = [128 + 90 * np.sin(0.8 * (x + share * w[..., 0])) for share in (0, 1, 0)]
    images = np.stack(waves, axis=-1) + rng.normal(0, 1, (SAMPLES, SIDE, SIDE, 3))
    shard = Shard(
        images=np.rint(images).astype(np.uint8),
        displacements=w,
        masks=w[..., 0] > 0,
        families=np.zeros(SAMPLES, np.uint8),
    )
    write_index(folder, {"schema": SCHEMA, "families": list(FAMILIES)})
    shard.save(folder / "shard_00000.npz")
    return shard


def config(folder: Path) -> TrainConfig:
    losses = {"charbonnier": 0, "squared": 1, "mask": 1}
    stage = {"name": "one", "pools": {"some": 1}, "steps": 60, "learning_rate": (3e-3, 1e-3)}
    return TrainConfig.model_validate(
        {
            "name": "colour",
            "network": {"channels": 3, "width": 4},
            "pools": {"some": {"folder": folder}},
            "validation": "some",
            "batch": 6,
            "augmentation": {"symmetries": "none"},
            "stages": [stage | {"losses": losses}],
        }
    )


def test_three_channels_are_trained_exported_and_run(tmp_path: Path) -> None:
    torch.set_num_threads(1)
    shard = colour_samples(tmp_path / "samples")
    assert np.array_equal(Shard.load(tmp_path / "samples/shard_00000.npz").masks, shard.masks)
    plan = config(tmp_path / "samples")
    train_network(plan, tmp_path / "run", report=lambda *_: None)
    path = export_checkpoint(plan, tmp_path / "run" / LAST, tmp_path / "colour.onnx")
    network = Network(path)
    assert network.channels == 3
    planes = shard.images[0].transpose(2, 0, 1).astype(np.float32) / 255
    middle, plume = np.s_[:, 12:20, 12:20], network(planes)
    grey = network(np.repeat(planes[:1], 3, axis=0))
    assert plume["displacement"][0, 12:20, 12:20].mean() > 0.2
    assert plume["logit"][middle].mean() > grey["logit"][middle].mean() + 1


def test_the_single_frame_detector_feeds_it_grey_thrice(tmp_path: Path) -> None:
    colour_samples(tmp_path / "samples")
    plan = config(tmp_path / "samples")
    stages = (plan.stages[0].model_copy(update={"steps": 1}),)
    plan = plan.model_copy(update={"stages": stages})
    train_network(plan, tmp_path / "run", report=lambda *_: None)
    path = export_checkpoint(plan, tmp_path / "run" / LAST, tmp_path / "colour.onnx")
    image = np.random.default_rng(1).integers(0, 255, (70, 90), dtype=np.uint8)
    estimate = SingleFrameEstimator(path).estimate(image)
    planes = np.repeat(image[None].astype(np.float32) / 255, 3, axis=0)
    expected = Network(path)(planes)["logit"][0]
    np.testing.assert_allclose(estimate.scores[..., 0], expected, atol=1e-5)
