"""The network over registered neighbours: clips, calibration, and what the detector says."""

import json
from pathlib import Path

import numpy as np
import pytest

from detect.calibration import Calibration, ClassCalibration
from detect.learning.augmentation import augment_sample
from detect.learning.clips import KINDS, TrainingClip, clip_path
from detect.learning.config import AugmentationConfig, PoolConfig, TrainConfig
from detect.learning.registered_calibration import calibrate, main, read_clip
from detect.network import Network
from detect.registered import RegisteredDetector
from detect.registered.evidence_network import (
    CLASS_NAMES,
    SCORES,
    EvidenceNetwork,
    SurfaceClass,
    classify_surfaces,
)
from detect.registered.features import FEATURES, SMALL_PX, Plain, decode_feature, stack_features
from detect.registered.registration import Measurement
from geometry.errors import BadInputError
from tests.detect.onnx_files import convolution
from tests.detect.scenes import TwoWalls

CHANNELS = len(FEATURES)
RICH_ONLY = {"scores": list(SCORES), "classes": {"rich": vars(ClassCalibration(
    weights=(1.0, 0.0), offset=-2.0, prior=0.1, auroc=0.9))}}  # fmt: skip
SHAPE = (32, 48)


def network(path: Path, *, channels: int = CHANNELS, **metadata: object) -> Path:
    """Says the first two channels as displacement, and the first as logit."""
    kernels = {
        "displacement": np.eye(2, channels)[:, :, None, None],
        "log_variance": np.zeros((1, channels, 1, 1)),
        "logit": 4 * np.eye(1, channels)[:, :, None, None],
    }
    return convolution(path, kernels, **{"calibration": RICH_ONLY, **metadata})


def clip(amplitude_px: float, *, seed: int = 0, shape: tuple[int, int] = SHAPE) -> TrainingClip:
    """Two frames whose plume on the left the first channel shows through noise; sky on top."""
    rng = np.random.default_rng(seed)
    displacements = np.zeros((2, *shape, 2), np.float16)
    displacements[..., : shape[1] // 2, 0] = amplitude_px
    inputs = rng.normal(size=(2, CHANNELS, *shape))
    surface = np.ones((2, *shape), dtype=bool)
    surface[:, :4] = False
    inputs[:, 0] += 2 * ((displacements[..., 0] > 0) & surface)
    inputs[:, FEATURES.index("log_texture")] = np.log1p(100) / 3
    inputs[:, FEATURES.index("log_depth_edge")] = 0
    inputs[:, FEATURES.index("visible")] = 1
    return TrainingClip(
        inputs=inputs.astype(np.float16),
        displacements=displacements,
        surface=surface,
        amplitude_px=amplitude_px,
    )


def test_a_clip_comes_back_from_its_file(tmp_path: Path) -> None:
    one = clip(0.3)
    one.save(tmp_path / "lesson.npz")
    again = TrainingClip.load(tmp_path / "lesson.npz")
    for name in ("inputs", "displacements", "surface"):
        np.testing.assert_array_equal(getattr(again, name), getattr(one, name))
    assert again.amplitude_px == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("amplitude_px", "kind", "plume_px"),
    [(0.0, "plume-free", 0.02), (0.05, "faint", 0.02), (0.3, "weak", 0.09), (1.0, "strong", 0.3)],
)
def test_what_counts_follows_the_strength(amplitude_px: float, kind: str, plume_px: float) -> None:
    one = clip(amplitude_px)
    assert KINDS[one.kind] == kind
    assert one.limits_px == pytest.approx((plume_px, 0.01))
    assert not one.visible_displacements()[:, :4].any()


def test_a_pool_of_clips(tmp_path: Path) -> None:
    pools = pytest.importorskip("detect.learning.pools")
    for seed, amplitude_px in ((7, 0.3), (8, 0.0)):
        clip(amplitude_px, seed=seed).save(clip_path(tmp_path, seed))
    both = pools.SamplePool.load(PoolConfig(folder=tmp_path))
    assert both.images.shape == (4, *SHAPE, CHANNELS)
    assert [KINDS[k] for k in both.families] == ["weak"] * 2 + ["plume-free"] * 2
    second = pools.SamplePool.load(PoolConfig(folder=tmp_path, seeds=((8, 9),)))
    np.testing.assert_array_equal(second.images, both.images[2:])
    config = config_of(tmp_path, {"some": {"folder": "."}})
    np.testing.assert_allclose(both.limits_px([0, 3], config), [(0.09, 0.01), (0.02, 0.01)])
    with pytest.raises(BadInputError, match="lesson_000009"):
        pools.SamplePool.load(PoolConfig(folder=tmp_path, seeds=((8, 10),)))
    clip(0.3, shape=(32, 32)).save(clip_path(tmp_path, 9))
    with pytest.raises(BadInputError, match="several sizes"):
        pools.SamplePool.load(PoolConfig(folder=tmp_path))


def config_of(folder: Path, pools: dict[str, object]) -> TrainConfig:
    path = folder / "config.json"
    stage = {"name": "one", "pools": {"some": 1}, "steps": 3, "learning_rate": [1e-3, 1e-4]}
    plain = {
        "name": "tiny",
        "network": {"width": 4, "channels": CHANNELS, "normalise": False},
        "pools": pools,
        "validation": "some",
        "batch": 2,
        "crop_px": 16,
        "augmentation": {"symmetries": "mirror", "vectors": [[0, 1]], "negate": True},
        "stages": [stage],
    }
    path.write_text(json.dumps(plain))
    return TrainConfig.load(path)


def test_a_network_is_trained_on_clips_and_exported(tmp_path: Path) -> None:
    torch = pytest.importorskip("torch")
    from detect.learning.export import export_training
    from detect.learning.trainer import train_network

    torch.set_num_threads(1)
    for seed in (7, 8):
        clip(0.3, seed=seed).save(clip_path(tmp_path, seed))
    config = config_of(tmp_path, {"some": {"folder": ".", "seeds": [[7, 9]]}})
    train_network(config, tmp_path / "run", report=lambda stage, share: None)
    files = export_training(config, tmp_path / "run")
    assert [file.name for file in files] == ["best.onnx", "last.onnx"]
    output = EvidenceNetwork(files[-1]).evaluate(clip(0.3).inputs[0].astype(np.float32))
    assert output.displacement.shape == (*SHAPE, 2)
    assert np.isfinite(output.sigma_px).all()


def test_other_seeds_lead_elsewhere(tmp_path: Path) -> None:
    one, other, plain = (
        config_of(tmp_path, {"some": {"folder": ".", **more}})
        for more in ({"seeds": [[7, 9]]}, {"seeds": [[7, 8]]}, {})
    )
    assert len({config.weights_digest(3) for config in (one, other, plain)}) == 3
    assert one.pools["some"].all_seeds() == [7, 8]


def test_an_empty_range_of_seeds_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="some: seeds are ranges"):
        config_of(tmp_path, {"some": {"folder": ".", "seeds": [[7, 9], [9, 9]]}})


def test_a_denser_gas_bends_the_other_way() -> None:
    rng = np.random.default_rng(0)
    image, displacement = rng.normal(size=(3, 4, 4)), rng.normal(size=(2, 4, 4))
    how = AugmentationConfig(symmetries="none", vectors=((0, 1),), negate=True)
    signs = set()
    for seed in range(8):
        changed, moved = augment_sample(image, displacement, "", how, np.random.default_rng(seed))
        sign = float(np.sign(moved[0, 0, 0] / displacement[0, 0, 0]))
        np.testing.assert_allclose(moved, sign * displacement, rtol=1e-6)
        np.testing.assert_allclose(changed[:2], sign * image[:2], rtol=1e-6)
        np.testing.assert_allclose(changed[2], image[2], rtol=1e-6)
        signs.add(sign)
    assert signs == {1.0, -1.0}


@pytest.mark.parametrize(
    ("name", "attribute"),
    [
        ("log_texture", "texture"),
        ("log_depth_edge", "depth_edge_px"),
        ("visible", "visible"),
    ],
)
def test_features_tell_what_they_were_made_of(name: Plain, attribute: str) -> None:
    rng = np.random.default_rng(1)
    scalars = {n: rng.uniform(0.1, 5, SHAPE).astype(np.float32) for n in (
        "misfit", "scatter_px", "variance_factor", "visible", "one_sidedness",
        "texture", "relative_inverse_depth", "depth_edge_px")}  # fmt: skip
    vectors = rng.normal(size=(2, *SHAPE, 2)).astype(np.float32)
    measurement = Measurement(displacement=vectors[0], first_displacement=vectors[1], **scalars)
    inputs = stack_features(measurement, np.full(SHAPE, 0.1, np.float32))
    np.testing.assert_allclose(
        decode_feature(inputs, name), getattr(measurement, attribute), rtol=1e-4
    )
    np.testing.assert_allclose(decode_feature(inputs, "log_sigma"), 0.1, rtol=1e-4)
    for axis, component in enumerate(("displacement_x", "displacement_y")):
        np.testing.assert_allclose(
            decode_feature(inputs, component), vectors[0, ..., axis], rtol=1e-3
        )


def test_places_are_by_texture_and_depth_edge() -> None:
    texture, edge_px = np.array([1.0, 5.0, 10.0, 100.0, 100.0]), np.array([0, 0.2, 0.5, 0.9, 2.0])
    assert classify_surfaces(texture, edge_px).tolist() == list(SurfaceClass)


def test_the_network_finds_where_and_the_measurement_how_much(
    walls_without_plume: TwoWalls, tmp_path: Path
) -> None:
    scene = walls_without_plume
    plain = RegisteredDetector()
    learned = RegisteredDetector(weights=network(tmp_path / "n.onnx"))
    assert (plain.name, learned.name) == ("registered-plain", "registered")
    detection = learned.detect(scene.frames, scene.key)
    by_hand = plain.detect(scene.frames, scene.key)
    for name in ("displacement", "sigma_px", "inverse_depth"):
        np.testing.assert_array_equal(getattr(detection, name), getattr(by_hand, name))
    told = plain.measure(scene.frames, scene.key)
    assert told is not None
    measured = (told[0].texture >= 0.3) & (told[0].visible >= 1) & (told[0].one_sidedness < 2)
    assert 0.2 < measured.mean() < 0.95
    assert not detection.llr[~measured].any()
    rich = measured & (
        classify_surfaces(told[0].texture, told[0].depth_edge_px) == SurfaceClass.RICH
    )
    logit = 4 * np.arcsinh(told[0].displacement[..., 0] / 0.1)
    llr = np.clip(logit - 2 - np.log(0.1 / 0.9), -1.5, 4)
    assert rich.mean() > 0.1
    np.testing.assert_allclose(detection.llr[rich], llr[rich], atol=1e-4)
    assert not detection.llr[measured & ~rich].any()


def test_a_badly_registered_frame_has_no_evidence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    evidence_network = EvidenceNetwork(network(tmp_path / "n.onnx"))
    runs = []
    call = Network.__call__
    monkeypatch.setattr(Network, "__call__", lambda *given: runs.append(1) or call(*given))
    inputs = clip(0.3).inputs[0].astype(np.float32)
    row = FEATURES.index("log_sigma")
    for sigma_px, measures in ((0.05, True), (0.5, False)):
        inputs[row] = np.log(sigma_px / SMALL_PX)
        output = evidence_network.evaluate(inputs)
        assert output.measured.any() == measures
        assert len(runs) == 1
        assert output.llr(evidence_network.read_calibration()).any() == measures
    inputs[FEATURES.index("visible")] = 0
    assert not evidence_network.evaluate(inputs).measured.any()


def test_a_network_may_say_nothing_of_its_response(tmp_path: Path) -> None:
    assert RegisteredDetector().response is None
    assert RegisteredDetector(weights=network(tmp_path / "n.onnx")).response is None
    broken = network(tmp_path / "broken.onnx", response={"ratios": [0, 1]})
    with pytest.raises(BadInputError, match=r"broken\.onnx: not a response"):
        RegisteredDetector(weights=broken)


def test_other_networks_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="13 channels"):
        RegisteredDetector(weights=network(tmp_path / "grey.onnx", channels=1))
    with pytest.raises(BadInputError, match="not a calibration"):
        RegisteredDetector(weights=network(tmp_path / "raw.onnx", calibration=None))
    other = {**RICH_ONLY, "scores": ["logit", "waves"]}
    with pytest.raises(BadInputError, match="other scores"):
        RegisteredDetector(weights=network(tmp_path / "other.onnx", calibration=other))


def test_calibration_makes_the_score_a_log_likelihood_ratio(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Two normal scores a distance of 2 apart: the llr is 2 s - 2; the network says 4 s."""
    pytest.importorskip("onnx")
    for seed in range(12):
        clip(0.3, seed=seed, shape=(48, 64)).save(clip_path(tmp_path, seed))
    path = network(tmp_path / "n.onnx", calibration=None)
    main([str(path), "--clips", str(tmp_path), "--seeds", "0", "8"])
    assert "rich: ClassCalibration" in capsys.readouterr().out
    evidence_network = EvidenceNetwork(path)
    calibration = evidence_network.read_calibration()
    assert set(calibration.scales) == {"rich"}
    response = evidence_network.read_response()
    assert response is not None
    still, displaced = response(np.array([[0.0, 0.3]]), np.array([[0.1, 0.1]]))[0]
    assert still < -0.5 < 0.5 < displaced
    assert RegisteredDetector(weights=path).response == response
    held_out = clip(0.3, seed=11, shape=(48, 64))
    for read in read_clip(evidence_network, held_out):
        s = read.inputs[0].astype(np.float32)
        expected = np.clip(2 * s - 2, -1.5, 4)
        np.testing.assert_allclose(read.output.llr(calibration), expected, atol=0.35)
        assert read.positive[4:, :32].all()
        assert not read.positive[:4].any()


def test_no_clips_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = network(tmp_path / "n.onnx")
    with pytest.raises(SystemExit):
        main([str(path), "--clips", str(tmp_path)])
    assert "no clips" in capsys.readouterr().err


def test_a_class_without_evidence_stays_silent(tmp_path: Path) -> None:
    pytest.importorskip("onnx")
    still = [clip(0.0, seed=seed) for seed in range(3)]
    calibration = calibrate(network(tmp_path / "n.onnx"), still)
    assert calibration == Calibration(scores=SCORES, scales={})
    assert len(CLASS_NAMES) == 5
