"""Adapting: weights come back from their file, samples do not leak, the result can be used."""

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import onnx
import pytest
import torch
import typer
from typer.testing import CliRunner, Result

from detect import kinds
from detect.detection import Frames
from detect.differential import lucas_kanade
from detect.dybs import DybsDetector
from detect.learning import background_adaptation as teaching
from detect.learning import reread
from detect.learning.background_adaptation import Adapted, Score, adapt, divided, each, score
from detect.learning.config import NetworkConfig
from detect.learning.export import save_network
from detect.learning.networks import PlumeNet, build_network
from detect.learning.reread import read_network, revive_norms
from detect.network import Network
from detect.synthesis.camera import naive_warp
from detect.synthesis.own_images import HALF_SCALE, sample_own_images, sample_side
from geometry.errors import BadInputError
from locate.commands.adapt import adapt as command


def silent(what: str, share: float) -> None:
    pass


def trained_looking(width: int = 8) -> PlumeNet:
    """A network whose norms and head are not as fresh ones are."""
    torch.manual_seed(3)
    network = build_network(NetworkConfig(width=width))
    assert isinstance(network, PlumeNet)
    for module in network.modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            module.weight.data.uniform_(0.5, 2)
            module.bias.data.uniform_(-0.5, 0.5)
            module.running_mean.uniform_(-1, 1)
            module.running_var.uniform_(0.2, 3)
    network.head.weight.data.normal_(0, 0.3)
    return network.eval()


@pytest.fixture(scope="module")
def start(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("start") / "start.onnx"
    return save_network(trained_looking(), path, "small", 1, {"steps": 1})


def wall(seed: int = 0, shape: tuple[int, int] = (176, 208)) -> np.ndarray:
    noise = np.random.default_rng(seed).standard_normal(shape).astype(np.float32)
    return np.clip(128 + 90 * cv2.GaussianBlur(noise, (0, 0), 1.0), 0, 255).astype(np.uint8)


def test_weights_come_back_from_the_file(start: Path) -> None:
    stored = read_network(start)
    assert stored.name == "small"
    assert stored.config.width == 8
    image = torch.rand(2, 1, 48, 64)
    with torch.no_grad():
        for there, here in zip(trained_looking()(image), stored.network(image), strict=True):
            assert torch.allclose(there, here, atol=1e-4)


def test_a_network_of_features_comes_back_too() -> None:
    path = kinds.REGISTERED.find_weights()
    stored = read_network(path)
    assert not stored.config.normalise
    features = np.random.default_rng(0).normal(size=(13, 48, 64)).astype(np.float32)
    with torch.no_grad():
        here = stored.network(torch.from_numpy(features[None])).logit[0].numpy()
    np.testing.assert_allclose(here, Network(path)(features)["logit"], atol=1e-4)


def test_revived_norms_say_the_same_and_can_be_trained(start: Path) -> None:
    network = read_network(start).network
    images = torch.from_numpy(np.stack([wall(i)[:64, :64] for i in range(16)])[:, None] / 255)
    images = images.float()
    with torch.no_grad():
        before = network(images)
        revive_norms(network, images)
        after, training = network(images), network.train()(images)
    for then, now in zip(before, after, strict=True):
        assert torch.allclose(then, now, atol=1e-3)
    spread = float(before.displacement.std())
    assert float((training.displacement - before.displacement).std()) < 0.05 * spread


def test_other_files_are_refused(
    start: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = onnx.load(start)
    (stem,) = (t for t in model.graph.initializer if t.name == "network.stem.0.weight")
    stem.name = "network.stem.0.weight_quantized"
    onnx.save(model, tmp_path / "other.onnx")
    monkeypatch.setattr(reread, "Network", lambda _: Network(start))
    with pytest.raises(BadInputError, match=r"other\.onnx: its weights are not those"):
        read_network(tmp_path / "other.onnx")
    monkeypatch.undo()
    (tmp_path / "text.onnx").write_text("no network")
    with pytest.raises(BadInputError, match=r"text\.onnx: not a readable"):
        read_network(tmp_path / "text.onnx")


def test_still_samples_lie_on_the_pixels_of_the_halved_image() -> None:
    image = wall()
    wide = cv2.copyMakeBorder(image, 0, 32, 0, 32, cv2.BORDER_REFLECT_101)
    halved = cv2.resize(wide, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA).astype(float)
    shard = sample_own_images([image], 24, seed=1, scale=HALF_SCALE)
    still = [s.image for s in each(shard) if not s.displacement.any()]
    assert len(still) >= 3
    for sample in still:
        found = cv2.matchTemplate(
            halved.astype(np.float32), sample.astype(np.float32), cv2.TM_SQDIFF
        )
        y, x = np.unravel_index(found.argmin(), found.shape)
        part = halved[y : y + sample.shape[0], x : x + sample.shape[1]]
        shift_px = lucas_kanade(np.rint(part).astype(np.uint8), sample)[8:-8, 8:-8]
        assert np.abs(np.median(shift_px, axis=(0, 1))).max() < 0.02


def detail(image: np.ndarray, where: np.ndarray) -> np.ndarray:
    """What fine detail the pixels hold, and how many they are."""
    fine = cv2.Laplacian(image.astype(np.float32), cv2.CV_32F)
    return np.array([(fine[where] ** 2).sum(), where.sum()])


def test_halved_samples_do_not_leak_where_a_software_warp_does() -> None:
    image = wall(shape=(400, 400))
    halved = cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    camera, software = np.zeros((2, 2)), np.zeros((2, 2))
    for sample in each(sample_own_images([image], 50, seed=2, scale=HALF_SCALE)):
        size_px = np.linalg.norm(sample.displacement, axis=-1)
        crop = halved[: size_px.shape[0], : size_px.shape[1]]
        warped = naive_warp(crop, sample.displacement)
        for k, where in enumerate((size_px > 0.2, size_px < 0.02)):
            camera[k] += detail(sample.image, where)
            software[k] += detail(warped, where)
    assert camera[0, 1] > 10_000
    plume, still = camera[:, 0] / camera[:, 1]
    assert plume / still == pytest.approx(1, abs=0.06)
    plume, still = software[:, 0] / software[:, 1]
    assert plume / still < 0.8


def test_samples_are_the_same_for_the_same_seed() -> None:
    first, again = (sample_own_images([wall()], 3, seed=5, scale=HALF_SCALE) for _ in range(2))
    assert (first.images == again.images).all()
    assert (first.displacements == again.displacements).all()
    assert (sample_own_images([wall()], 3, seed=6, scale=HALF_SCALE).images != first.images).any()


def test_small_images_are_named() -> None:
    with pytest.raises(BadInputError, match=r"100 px on its shorter side; give 128 or more"):
        sample_side([wall(), wall(shape=(100, 300))], 256)


@pytest.mark.parametrize(("count", "held"), [(1, 1), (2, 1), (5, 1), (10, 2), (40, 8)])
def test_held_out_images_are_not_learned_from(count: int, held: int) -> None:
    images = [np.full((2, 2), i, np.uint8) for i in range(count)]
    learned, judged = divided(images)
    assert len(judged) == held
    if count > 1:
        assert len(learned) == count - held
        assert not {int(i[0, 0]) for i in learned} & {int(i[0, 0]) for i in judged}


def test_adapted_network_is_a_detector_for_images_of_full_size(
    start: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(teaching, "SAMPLES", 6)
    images = [wall(i) for i in range(3)]
    told: list[str] = []
    path = tmp_path / "a.onnx"
    answer = adapt(start, images, path, minutes=0.05, report=lambda what, _: told.append(what))
    assert [path.name for path in tmp_path.iterdir()] == ["a.onnx"]
    assert (answer.learned, answer.held_out) == (2, 1)
    assert answer.before != answer.after
    assert told[0] == "samples"
    assert told[-1] == "calibration"
    network = Network(path)
    assert float(network.metadata["scale"]) == HALF_SCALE
    assert network.name == "small-adapted"
    found = DybsDetector(path).detect(Frames(images=[wall(9, (101, 133))]), 0)
    assert found.llr.shape == (101, 133)
    again = read_network(path).config
    assert again.width == 8


def test_one_image_makes_no_evidence(
    start: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(teaching, "SAMPLES", 4)
    answer = adapt(start, [wall()], tmp_path / "a.onnx", minutes=0.02, report=silent)
    assert (answer.held_out, answer.reliable_classes) == (0, ())
    found = DybsDetector(tmp_path / "a.onnx").detect(Frames(images=[wall()]), 0)
    assert not found.llr.any()


def test_score_knows_a_perfect_answer_from_none(start: Path) -> None:
    before = score(start, each(sample_own_images([wall()], 6, seed=0, scale=1)))
    assert abs(before.correlation) < 0.3
    assert before.error_px > before.zero_error_px / 2
    assert 0.05 < before.zero_error_px < 1


def typed(*arguments: object) -> Result:
    app = typer.Typer()
    app.command()(command)
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def test_command_says_in_one_line_what_is_missing(
    start: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cv2.imwrite(str(tmp_path / "wall.png"), wall())
    cv2.imwrite(str(tmp_path / "small.png"), wall(shape=(90, 90)))
    good = (tmp_path / "wall.png", "-o", tmp_path / "a.onnx", "--weights", start)
    none = replace(kinds.DYBS, installed_weights=tmp_path / "none.onnx")
    monkeypatch.setattr(kinds, "DYBS", none)
    for arguments, words in (
        (good[:3], "no weights to begin with"),
        ((*good[:2], tmp_path / "a.pt", *good[3:]), "name of an .onnx file"),
        ((tmp_path / "small.png", *good[1:]), "90 px"),
        ((tmp_path / "gone.png", *good[1:]), "no such file"),
    ):
        failure = typed(*arguments).exception
        assert isinstance(failure, BadInputError), arguments
        assert words in str(failure)
        assert "\n" not in str(failure)
    monkeypatch.setitem(sys.modules, "torch", None)
    failure = typed(*good).exception
    assert "torch is missing; pip install" in str(failure)
    assert not (tmp_path / "a.onnx").exists()


def test_command_on_a_run_folder(
    start: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "run/frames").mkdir(parents=True)
    for i in range(100):
        cv2.imwrite(str(tmp_path / f"run/frames/{i:06d}.png"), np.full((8, 8), i, np.uint8))
    seen: list[int] = []

    def teach(_: Path, images: Sequence[np.ndarray], path: Path, **__: object) -> Adapted:
        seen.extend(int(image[0, 0]) for image in images)
        figures = Score(auroc=0.5, correlation=0, error_px=0.2, zero_error_px=0.1)
        return Adapted(
            learned=27, held_out=7, before=figures, after=figures, reliable_classes=("lattice",)
        )

    monkeypatch.setattr(teaching, "adapt", teach)
    result = typed(tmp_path / "run", "-o", tmp_path / "a.onnx", "--weights", start)
    assert result.exit_code == 0, result.output
    assert seen == list(range(0, 100, 3))
    assert "Learned from 27; on 7 held-out images" in result.output
    assert "evidence in texture that is: lattice" in result.output
