"""Training: what a network sees, that it goes on where it was killed, and what leaves it."""

import json
import os
import resource
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NoReturn

import numpy as np
import pytest

pytest.importorskip("torch")

import onnx
import onnxruntime
import torch

import detect
from detect.learning import losses, trainer
from detect.learning.augmentation import apply_symmetry
from detect.learning.batches import StageBatches
from detect.learning.checkpoint import load_weights, read_checkpoint, read_journal
from detect.learning.config import NetworkConfig, PoolConfig, TrainConfig
from detect.learning.export import (
    export_checkpoint,
    export_training,
    quantise_network,
    write_metadata,
)
from detect.learning.networks import PaperUNet, PlumeNet, Prediction, build_network
from detect.learning.plot import plot_training
from detect.learning.pools import SamplePool
from detect.learning.render import render_missing
from detect.learning.trainer import BEST, LAST, train_network
from detect.learning.validation import validate_network
from detect.synthesis import Recipe, render_dataset
from detect.synthesis.dataset import SCHEMA, shards_in, write_index
from geometry.atomic import is_unfinished
from geometry.errors import BadInputError, UnwritableError

SAMPLES, SIDE = 24, 32
LIMITS_PX = torch.tensor([[0.06, 0.02]])
CHILD = """
import os, signal, sys
from pathlib import Path
import torch
from detect.learning.config import TrainConfig
from detect.learning.trainer import train_network
torch.set_num_threads(1)
done = 0
def report(stage, share):
    global done
    done += 1
    if done == {kill_at}:
        os.kill(os.getpid(), signal.SIGKILL)
train_network(TrainConfig.load(Path(sys.argv[1])), Path(sys.argv[2]), report=report)
"""


def quiet(stage: str, share: float) -> None:
    pass


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("data")
    recipe = Recipe(families={"sinusoid": 1, "lines": 1}, size_px=SIDE, plume_length=(0.5, 2))
    render_dataset(recipe, SAMPLES, folder / "samples")
    return folder


STAGE = {
    "name": "first",
    "pools": {"some": 1},
    "steps": 8,
    "learning_rate": [1e-3, 1e-4],
    "losses": {"likelihood": 0.3},
}


def plain(**changes: object) -> dict[str, object]:
    return {
        "name": "tiny",
        "network": {"width": 4},
        "pools": {"some": {"folder": "samples"}},
        "validation": "some",
        "batch": 2,
        "log_every": 2,
        "checkpoint_every": 3,
        "validate_every": 6,
        "augmentation": {"invert": ["sinusoid"], "gain": [0.8, 1.0]},
        "stages": [STAGE, {**STAGE, "name": "second", "families": {"lines": 1}, "steps": 4}],
    } | changes


def config_of(data: Path, **changes: object) -> TrainConfig:
    path = data / "config.json"
    path.write_text(json.dumps(plain(**changes)))
    return TrainConfig.load(path)


@pytest.fixture(scope="module")
def trained(data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    torch.set_num_threads(1)
    return train_network(config_of(data), tmp_path_factory.mktemp("run"), report=quiet).parent


def test_a_killed_training_goes_on_to_the_same_weights(
    data: Path, trained: Path, tmp_path: Path
) -> None:
    (data / "config.json").write_text(json.dumps(plain()))
    child = [sys.executable, "-c", CHILD.format(kill_at=7), str(data / "config.json"), tmp_path]
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    killed = subprocess.run(child, env=environment, capture_output=True, check=False)
    assert killed.returncode == -signal.SIGKILL, killed.stderr.decode()
    assert read_checkpoint(tmp_path / LAST)["step"] == 6
    train_network(config_of(data), tmp_path, report=quiet)
    ours, theirs = (read_checkpoint(run / LAST) for run in (tmp_path, trained))
    assert ours["step"] == theirs["step"] == 12
    for name, weights in theirs["network"].items():
        assert torch.equal(ours["network"][name], weights), name
    assert _steps(tmp_path) == _steps(trained)


@pytest.fixture
def fill_disk() -> Iterator[Callable[[int], None]]:
    """Lets this process write files of so many bytes at most, as a full disk does."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    yield lambda size: resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize(
    ("name", "size", "changes"),
    [
        ("journal.jsonl", 100, {}),
        ("best.pt", 10_000, {}),
        ("last.pt", 10_000, {"validate_every": 12}),
    ],
)
def test_a_training_outlives_a_full_disk(
    data: Path,
    trained: Path,
    tmp_path: Path,
    fill_disk: Callable[[int], None],
    name: str,
    size: int,
    changes: dict[str, object],
) -> None:
    def report(_stage: str, share: float) -> None:
        if share == 5 / 8:
            fill_disk(size)

    config = config_of(data, **changes)
    with pytest.raises(UnwritableError, match=rf"{name}: cannot be written \(File too large\)"):
        train_network(config, tmp_path, report=report)
    assert read_checkpoint(tmp_path / LAST)["step"] == 3
    assert not [path for path in tmp_path.iterdir() if is_unfinished(path)]
    fill_disk(resource.RLIM_INFINITY)
    train_network(config, tmp_path, report=quiet)
    ours, theirs = (read_checkpoint(run / LAST) for run in (tmp_path, trained))
    assert ours["step"] == theirs["step"]
    for key, weights in theirs["network"].items():
        assert torch.equal(ours["network"][key], weights), key
    if not changes:
        assert _steps(tmp_path) == _steps(trained)


def test_samples_and_networks_outlive_a_full_disk(
    data: Path, trained: Path, tmp_path: Path, fill_disk: Callable[[int], None]
) -> None:
    (tmp_path / "recipe.yaml").write_text("families: {sinusoid: 1}\nsize_px: 32\n")
    pools = {"some": {"folder": "made", "samples": 3, "recipe": "recipe.yaml"}}
    making = config_of(tmp_path, pools=pools)
    network = tmp_path / "last.onnx"
    write = partial(export_checkpoint, config_of(data), trained / LAST, network)
    fill_disk(2000)
    with pytest.raises(UnwritableError, match=r"shard_00000\.npz: cannot be written"):
        render_missing(making, tmp_path, report=quiet)
    with pytest.raises(UnwritableError, match=r"last\.onnx: cannot be written"):
        write()
    assert not [path for path in tmp_path.rglob("*") if is_unfinished(path) or path == network]
    fill_disk(resource.RLIM_INFINITY)
    render_missing(making, tmp_path, report=quiet)
    assert len(SamplePool.load(making.pools["some"])) == 3
    assert write().exists()
    fill_disk(2000)
    with pytest.raises(UnwritableError, match="MiB are needed"):
        quantise_network(network, tmp_path / "int8.onnx", SamplePool.load(making.pools["some"]))
    assert not (tmp_path / "int8.onnx").exists()


def test_a_journal_is_read_up_to_what_is_no_line_of_it(tmp_path: Path) -> None:
    for torn in ('{"step": 4, "ki', "[]", '{"kind": "train"}', '{"step": "4"}'):
        (tmp_path / "journal.jsonl").write_text('{"step": 2}\n' + torn + '\n{"step": 6}\n')
        assert read_journal(tmp_path) == [{"step": 2}]


def _steps(folder: Path) -> list[tuple[str, int]]:
    return [(line["kind"], line["step"]) for line in read_journal(folder)]


def test_a_config_that_leads_elsewhere_is_refused(data: Path, trained: Path) -> None:
    for change in ({"seed": 1}, {"batch": 3}, {"network": {"width": 8}}):
        with pytest.raises(BadInputError, match="another config"):
            train_network(config_of(data, **change), trained, report=quiet)


def test_later_stages_may_change(data: Path, trained: Path) -> None:
    config = config_of(data)
    longer = config.model_copy(
        update={"stages": (*config.stages, config.stages[0]), "checkpoint_every": 1}
    )
    assert longer.weights_digest(config.steps) == config.weights_digest(config.steps)
    shorter = config.model_copy(update={"stages": config.stages[:1]})
    assert shorter.weights_digest(8) == config.weights_digest(8) != config.weights_digest(9)


def test_a_blended_stage_ends_between_its_two_ends(
    data: Path, trained: Path, tmp_path: Path
) -> None:
    config = config_of(data)
    first, second = config.stages
    halves = (first, second.model_copy(update={"blend": 0.25}))
    whole = read_checkpoint(trained / LAST)["network"]
    config = config.model_copy(update={"stages": halves})
    ended = read_checkpoint(train_network(config, tmp_path, report=quiet))["network"]
    began = read_checkpoint(tmp_path / "before.pt")["network"]
    for name, weights in ended.items():
        if weights.is_floating_point():
            torch.testing.assert_close(weights, 0.75 * began[name] + 0.25 * whole[name])


def test_a_training_begins_with_an_exported_network(data: Path, tmp_path: Path) -> None:
    began = train_network(config_of(data, network={"width": 8}), tmp_path / "one", report=quiet)
    exported = export_training(config_of(data, network={"width": 8}), began.parent)[0]
    # nothing is learned, so that the weights are still those of the file
    still = plain()["stages"][0] | {"steps": 1, "learning_rate": [0, 0]}
    config = config_of(data, network={"width": 8}, initial=str(exported), stages=[still])
    last = train_network(config, tmp_path / "two", report=quiet)
    network = build_network(config.network)
    load_weights(network, read_checkpoint(last), last)
    image = np.random.default_rng(0).random((1, 1, 64, 64), dtype=np.float32)
    with torch.no_grad():
        ours = network.eval()(torch.from_numpy(image)).displacement.numpy()
    theirs = _session(exported).run(["displacement"], {"image": image})[0]
    assert np.abs(ours - theirs).max() < 0.1 * np.abs(theirs).max()
    with pytest.raises(BadInputError, match="another network"):
        train_network(config_of(data, initial=str(exported)), tmp_path / "three", report=quiet)


def test_a_batch_follows_from_its_step(data: Path) -> None:
    config = config_of(data)
    pools = {"some": SamplePool.load(config.pools["some"])}
    one, other = (StageBatches(config, config.stages[0], pools) for _ in range(2))
    _ = other[4]
    assert np.array_equal(one[5].image, other[5].image)
    assert not np.array_equal(one[5].image, one[6].image)
    assert one[5].image.shape == (2, 1, SIDE, SIDE)
    assert one[5].image.min() >= 0
    assert one[5].image.max() <= 1


def test_stages_draw_what_they_name(data: Path) -> None:
    config = config_of(data)
    pool = SamplePool.load(config.pools["some"])
    (lines,), _ = pool.group_samples({"lines": 1, "photo": 3}, np.ones(len(pool), dtype=bool))
    assert {pool.family_names[k] for k in pool.families[lines]} == {"lines"}
    (plumes,), _ = pool.group_samples(None, pool.select_reaching(0.06))
    assert 0 < len(plumes) < len(pool)
    assert all(np.abs(pool.displacements[k]).max() >= 0.06 for k in plumes)
    with pytest.raises(BadInputError, match="photo"):
        pool.group_samples({"photo": 1}, np.ones(len(pool), dtype=bool))


@pytest.mark.parametrize("symmetry", range(8))
def test_vectors_turn_with_the_image(symmetry: int) -> None:
    """I(p) = B(p + w(p)) holds after the turn, for the turned background."""
    y, x = np.mgrid[-8:9, -8:9].astype(np.float32)
    w = np.stack([0.3 + 0.02 * y, -0.4 + 0.03 * x]).astype(np.float32)

    def background(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.sin(0.9 * x + 0.2 * y) + 0.05 * y

    def turned_background(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        if symmetry & 4:
            x, y = y, x
        return background(-x if symmetry & 1 else x, -y if symmetry & 2 else y)

    image = background(x + w[0], y + w[1])[None].astype(np.float32)
    image, w = apply_symmetry(image, symmetry, ()), apply_symmetry(w, symmetry, ((0, 1),))
    assert image[0] == pytest.approx(turned_background(x + w[0], y + w[1]), abs=1e-5)


def test_a_fresh_network_says_no_displacement_at_any_size() -> None:
    for channels, height, width in ((1, 16, 16), (3, 48, 32)):
        network = PlumeNet(channels=channels, width=4).eval()
        says = network(torch.rand(2, channels, height, width))
        assert says.displacement.shape == (2, 2, height, width)
        assert says.logit.shape == says.log_variance.shape == (2, 1, height, width)
        assert not says.displacement.any()
        assert (says.logit < 0).all()


@pytest.mark.parametrize("network", [PlumeNet(width=4), PaperUNet(width=2)])
def test_nothing_beyond_the_receptive_field_counts(network: PlumeNet | PaperUNet) -> None:
    for part in network.modules():
        if isinstance(part, torch.nn.Conv2d | torch.nn.ConvTranspose2d):
            torch.nn.init.constant_(part.weight, 1 / part.weight[0].numel())
    at, reach = 135, network.receptive_px
    image = torch.rand(1, 1, 272, 272, requires_grad=True)
    network.eval()(image).displacement[0, 0, at, at].backward()
    felt = image.grad[0, 0].abs().nonzero() - at
    assert 0.75 * reach < felt.abs().max() <= reach


def test_contrast_and_brightness_are_taken_out() -> None:
    image = torch.rand(1, 1, 32, 32)
    network = PlumeNet(width=4)
    bright, dim = (network._normalised_planes(scale * image)[:, 4:] for scale in (1.0, 0.5))
    assert bright == pytest.approx(dim, abs=0.1)


def test_features_are_read_as_their_four_phases_would_be() -> None:
    network = PlumeNet(width=4, channels=3, normalise=False)
    wide, inputs = network.stem[0], torch.rand(1, 3, 16, 24)
    phases = wide.weight.reshape(-1, 3, 3, 2, 3, 2).permute(0, 1, 3, 5, 2, 4).reshape(-1, 12, 3, 3)
    shuffled = torch.nn.functional.pixel_unshuffle(inputs, 2)
    expected = torch.nn.functional.conv2d(shuffled, phases, padding=1)
    torch.testing.assert_close(wide(inputs), expected)


def test_the_papers_network() -> None:
    network = build_network(NetworkConfig(kind="paper", width=4))
    assert isinstance(network, PaperUNet)
    says = network.eval()(torch.rand(1, 1, 16, 32))
    assert says.displacement.shape == (1, 2, 16, 32)
    assert says.logit is None
    kinds = [type(layer) for layer in network.down[0]]
    assert kinds == [torch.nn.Conv2d, torch.nn.ReLU, torch.nn.BatchNorm2d] * 2
    assert len(network.down) == 5


def test_the_papers_training_runs(data: Path, tmp_path: Path) -> None:
    stage = {
        "name": "one",
        "pools": {"some": 0.5, "other": 0.5},
        "steps": 2,
        "learning_rate": [1e-4, 1e-4],
        "losses": {"charbonnier": 0, "squared": 1, "mask": 0},
    }
    config = config_of(
        data,
        network={"kind": "paper", "width": 4},
        pools={"some": {"folder": "samples"}, "other": {"folder": "samples", "samples": 5}},
        stages=[stage],
        optimiser="adam",
        crop_px=16,
        augmentation={"symmetries": "flips"},
    )
    train_network(config, tmp_path, report=quiet)
    says = read_journal(tmp_path)[-1]["families"]
    assert set(says) == {"sinusoid", "lines"}
    with pytest.raises(BadInputError, match="displacement alone"):
        config_of(data, network={"kind": "paper"})


def test_it_learns_what_is_there(data: Path) -> None:
    """A few samples by heart: the loss falls to a third and the sign is right."""
    torch.manual_seed(0)
    y, x = np.mgrid[:32, :32]
    w = 0.8 * np.exp(-((x - 16) ** 2 + (y - 16) ** 2) / 60).astype(np.float32)
    truth = torch.zeros(2, 2, 32, 32)
    truth[0, 0] = torch.from_numpy(w)
    image = torch.from_numpy(
        np.stack([np.sin(0.8 * (x + w)), np.sin(0.8 * x)])[:, None].astype(np.float32) / 2 + 0.5
    )
    network = PlumeNet(width=8).train()
    optimiser = torch.optim.AdamW(network.parameters(), lr=3e-3)
    weights = config_of(data).stages[0].losses
    values = []
    for _ in range(80):
        loss = losses.total_loss(network(image), truth, weights, LIMITS_PX)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        values.append(float(loss.detach()))
    assert np.mean(values[-5:]) < values[0] / 3
    with torch.inference_mode():
        says = network(image)
    assert float(says.displacement[0, 0, 16, 16]) > 0.4
    assert float(says.logit[0, 0, 16, 16]) > 0 > float(says.logit[1, 0, 16, 16])


def test_the_mask_looks_away_from_weak_displacement() -> None:
    truth = torch.zeros(1, 2, 1, 4)
    truth[0, 0, 0] = torch.tensor([0.0, 0.03, -0.07, 0.5])
    plume, asked = losses.mask_labels(truth, LIMITS_PX)
    assert plume.flatten().tolist() == [0, 0, 1, 1]
    assert asked.flatten().tolist() == [True, False, True, True]
    logit = torch.tensor([[[[0.0, 50.0, 0.0, 0.0]]]])
    assert float(losses.masked_cross_entropy(logit, plume, asked)) == pytest.approx(np.log(2))


def test_the_log_variance_settles_at_the_errors_variance() -> None:
    torch.manual_seed(0)
    sigma_px = 0.04
    error = torch.randn(1, 2, 64, 64) * sigma_px / losses.DISPLACEMENT_UNIT
    grid = torch.linspace(-9, -4, 101, requires_grad=True)
    maps = grid.reshape(-1, 1, 1, 1).expand(-1, 1, 64, 64)
    losses.beta_nll(error.expand(101, -1, -1, -1), maps).backward()
    crossing = float(grid.detach()[torch.argmin(grid.grad.abs())])
    assert crossing == pytest.approx(2 * np.log(sigma_px), abs=0.1)


def test_the_weights_of_the_losses_count() -> None:
    says = Prediction(torch.ones(1, 2, 4, 4), torch.zeros(1, 1, 4, 4), torch.zeros(1, 1, 4, 4))
    config = TrainConfig.model_validate(plain())
    weights = config.stages[0].losses
    none = weights.model_copy(
        update={"charbonnier": 0.0, "mask": 0.0, "likelihood": 0.0, "squared": 2.0}
    )
    truth = torch.zeros(1, 2, 4, 4)
    loss = losses.total_loss(says, truth, none, LIMITS_PX)
    assert float(loss) == pytest.approx(2 * (1 / losses.DISPLACEMENT_UNIT) ** 2)


def test_validation_knows_a_perfect_answer(data: Path) -> None:
    config = config_of(data)
    pool = SamplePool.load(config.pools["some"])
    truths = iter(
        np.moveaxis(pool.displacements, -1, 1).astype(np.float32).reshape(-1, 2, SIDE, SIDE)
    )

    def perfect(image: np.ndarray) -> dict[str, np.ndarray]:
        truth = np.stack([next(truths) for _ in image])
        return {"displacement": truth, "logit": np.linalg.norm(truth, axis=1, keepdims=True)}

    for score in validate_network(perfect, pool, config).values():
        assert score.auroc == 1
        assert score.epe_px == 0
        assert score.explained == 1


def test_onnx_says_what_torch_says(data: Path, trained: Path) -> None:
    config = config_of(data)
    assert [path.name for path in export_training(config, trained)] == [
        "best.onnx", "last.onnx", "last-int8.onnx",
    ]  # fmt: skip
    plain, int8 = (_session(trained / name) for name in ("last.onnx", "last-int8.onnx"))
    network = build_network(config.network)
    load_weights(network, read_checkpoint(trained / LAST), trained / LAST)
    for shape in ((1, 1, 16, 16), (2, 1, 48, 80)):
        image = np.random.default_rng(0).random(shape, dtype=np.float32)
        with torch.inference_mode():
            ours = network.eval()(torch.from_numpy(image))
        theirs = plain.run(list(Prediction._fields), {"image": image})
        for name, expected in zip(Prediction._fields, theirs, strict=True):
            assert getattr(ours, name).numpy() == pytest.approx(expected, abs=1e-4), name
    masks = [session.run(["logit"], {"image": image})[0] for session in (plain, int8)]
    assert np.std(masks[0]) > 1e-3
    assert np.std(masks[0] - masks[1]) < 0.2 * np.std(masks[0])
    kinds = {node.op_type for node in onnx.load(trained / "last-int8.onnx").graph.node}
    assert "QuantizeLinear" in kinds
    here = str(Path(__file__).parents[2]).encode()
    assert not any(here in (trained / n).read_bytes() for n in ("last.onnx", "last-int8.onnx"))


def test_a_file_says_what_it_is(data: Path, trained: Path) -> None:
    if not (trained / "last.onnx").exists():
        export_training(config_of(data), trained)
    write_metadata(trained / "last.onnx", {"calibration": "[1]"})
    for name, calibration in (("last", [1]), ("last-int8", None)):
        props = _session(trained / f"{name}.onnx").get_modelmeta().custom_metadata_map
        assert props["schema"] == "locate.network/1"
        assert (props["stride"], props["channels"]) == ("16", "1")
        assert json.loads(props["trained_on"])["steps"] == 12
        assert json.loads(props["calibration"]) == calibration
        assert props["name"] == {"last": "tiny", "last-int8": "tiny-int8"}[name]


def _session(path: Path) -> onnxruntime.InferenceSession:
    return onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])


def test_the_plot_shows_the_journal(trained: Path, tmp_path: Path) -> None:
    import cv2

    picture = cv2.imread(str(plot_training(trained, tmp_path / "plot.png")))
    assert picture is not None
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 10
    with pytest.raises(BadInputError, match="cannot be read"):
        plot_training(tmp_path, tmp_path / "plot.png")


def test_bad_configs_are_one_line(data: Path) -> None:
    for change, what in (
        ({"typo": 1}, "typo"),
        ({"validation": "nowhere"}, "nowhere"),
        ({"stages": []}, "stages"),
        ({"negative_px": 0.1}, "negative_px"),
        ({"crop_px": 100}, "crop_px"),
        ({"augmentation": {"vectors": [[0, 1]]}}, "no channel 1"),
        ({"batch": 10**9}, "batch"),
        ({"batch": True}, "batch: yes and no"),
        ({"network": {"width": 10**9}}, "width"),
        ({"stages": [{**STAGE, "learning_rate": [-1, 1e-3]}]}, "learning_rate"),
        ({"stages": [{**STAGE, "steps": 0}]}, "steps"),
        ({"pools": {"some": {"folder": "a", "seeds": [[0, 2**31]]}}}, "over 1000000 clips"),
    ):
        with pytest.raises(BadInputError, match=what) as caught:
            config_of(data, **change)
        assert "\n" not in str(caught.value)


def test_a_lack_of_memory_is_named(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(_: object) -> NoReturn:
        raise RuntimeError("DefaultCPUAllocator: can't allocate memory: you tried 9 bytes")

    monkeypatch.setattr(trainer, "build_network", fail)
    with pytest.raises(BadInputError, match="too little memory; lower batch"):
        train_network(config_of(data), tmp_path, report=quiet)


def test_too_few_samples_are_refused(data: Path) -> None:
    with pytest.raises(BadInputError, match="24 of 25 samples"):
        SamplePool.load(PoolConfig(folder=data / "samples", samples=25))
    assert len(SamplePool.load(PoolConfig(folder=data / "samples", samples=10))) == 10


def test_a_training_whose_validation_shows_no_plume_has_a_best_network(
    data: Path, tmp_path: Path
) -> None:
    still = tmp_path / "still"
    shard = next(shards_in(data / "samples"))
    write_index(still, {"schema": SCHEMA})
    replace(shard, displacements=np.zeros_like(shard.displacements)).save(still / "shard_00000.npz")
    pools = {"some": {"folder": "samples"}, "still": {"folder": str(still)}}
    config = config_of(data, pools=pools, validation="still", stages=[STAGE])
    train_network(config, tmp_path / "run", report=quiet)
    assert read_checkpoint(tmp_path / "run" / BEST)["step"] == 6


def test_samples_of_other_channels_are_refused(data: Path, tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="samples of 1 channels, the network has 3"):
        train_network(config_of(data, network={"channels": 3}), tmp_path, report=quiet)


def test_missing_samples_are_rendered_once(tmp_path: Path) -> None:
    (tmp_path / "recipe.yaml").write_text("families: {sinusoid: 1}\nsize_px: 32\n")
    pools = {"some": {"folder": "made", "samples": 3, "recipe": "recipe.yaml"}}
    config = config_of(tmp_path, pools=pools)
    told: list[str] = []
    for _ in range(2):
        render_missing(config, tmp_path, report=lambda what, share: told.append(what))
    assert told == ["samples: some"]
    assert len(SamplePool.load(config.pools["some"])) == 3
    more = config_of(tmp_path, pools={"some": {**pools["some"], "samples": 5}})
    render_missing(more, tmp_path, report=quiet)
    assert len(SamplePool.load(more.pools["some"])) == 5
    (tmp_path / "recipe.yaml").write_text("families: {photo: 1}\nphotos: mine\n")
    assert Recipe.load(tmp_path / "recipe.yaml", Path("data")).photos == Path("data/mine")
    (tmp_path / "recipe.yaml").write_text("families: [\n")
    with pytest.raises(BadInputError, match=r"recipe\.yaml: not YAML"):
        Recipe.load(tmp_path / "recipe.yaml", tmp_path)


@pytest.mark.parametrize("name", ["lite", "lite_fast", "paper"])
def test_the_shipped_configs_are_read(name: str) -> None:
    folder = Path(detect.__file__).parent / "dybs" / "training"
    config = TrainConfig.load(folder / f"{name}.yaml", Path("data"))
    assert config.name == "dybs-" + name.replace("_", "-")
    for pool in config.pools.values():
        assert pool.folder.parent == Path("data")
        if pool.recipe is not None:
            assert Recipe.load(pool.recipe, Path("data")).size_px == 128


def test_a_checkpoint_is_never_run(tmp_path: Path) -> None:
    path = tmp_path / "evil.pt"
    torch.save({"schema": os.system}, path)
    with pytest.raises(BadInputError, match="not a readable checkpoint"):
        read_checkpoint(path)
    for content in (b"nonsense", b"", b"\x80\x02"):
        path.write_bytes(content)
        with pytest.raises(BadInputError, match=r"not a readable checkpoint \(\w"):
            read_checkpoint(path)


def test_a_checkpoint_that_lacks_something_is_refused(trained: Path, tmp_path: Path) -> None:
    path, whole = tmp_path / LAST, torch.load(trained / LAST, weights_only=True)
    for name in ("digest", "step", "best", "network", "optimiser"):
        torch.save(whole | {name: None}, path)
        with pytest.raises(BadInputError, match=f"{name} is missing or wrong"):
            read_checkpoint(path)
    network = build_network(TrainConfig.model_validate(plain()).network)
    for weights in ({}, {"a": 1}, {1: torch.zeros(2)}):
        with pytest.raises(BadInputError, match="another network"):
            load_weights(network, {"network": weights}, path)


def test_a_checkpoint_of_another_optimiser_is_refused(data: Path, trained: Path) -> None:
    whole = torch.load(trained / LAST, weights_only=True)
    folder = data / "damaged"
    folder.mkdir()
    for state in ({}, {"state": {}, "param_groups": []}, {"state": 1, "param_groups": [1]}):
        torch.save(whole | {"optimiser": state}, folder / LAST)
        with pytest.raises(BadInputError, match="not the state of the config's optimiser"):
            train_network(config_of(data), folder, report=quiet)


def test_the_config_needs_no_torch() -> None:
    code = "import sys, detect.learning.config; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
