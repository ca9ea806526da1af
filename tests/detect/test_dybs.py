from pathlib import Path

import cv2
import numpy as np
import pytest

from detect.detection import Frames
from detect.dybs import DybsDetector
from detect.dybs.estimator import RefinedMeasurement, SingleFrameEstimator, combine_estimates
from detect.dybs.pattern_measurement import measure_pattern
from detect.texture import Texture, texture_classes
from geometry.errors import BadInputError
from tests.detect.onnx_files import convolution
from tests.detect.test_demodulation import lattice, plume
from tests.detect.test_edges import bars, slanted
from tests.detect.test_edges import plume as plume_before_edges

BY_THE_JUDGE = {"weights": [0.0, 1.0], "offset": 0.0, "prior": 0.1, "auroc": 0.95}
LATTICE_ONLY = {"scores": ["logit", "judge"], "classes": {"lattice": BY_THE_JUDGE}}
STRAIGHT_ONLY = {"scores": ["logit", "judge"], "classes": {"straight": BY_THE_JUDGE}}


PLACES = [5.0, 9.0, 26.0, 33.0, 37.0, 58.0, 63.0, 79.0, 83.0, 92.0, 110.0, 116.0]


def network(path: Path, **metadata: object) -> Path:
    """Says that nothing moves, with a sigma of 1 px, and that its logit is the brightness."""
    kernels = {
        "displacement": np.zeros((2, 1, 1, 1)),
        "log_variance": np.zeros((1, 1, 1, 1)),
        "logit": np.ones((1, 1, 1, 1)),
    }
    return convolution(path, kernels, **{"calibration": LATTICE_ONLY, **metadata})


@pytest.fixture
def half_lattice() -> np.ndarray:
    """Left a lattice behind a plume, right noise of the kind of nature."""
    image = lattice(plume(192, 384, peak_px=0.6), [(0.12, 0.02), (-0.03, 0.11)])
    image[:, 210:] = np.random.default_rng(0).integers(0, 255, (192, 174))
    return image


def test_a_plume_is_seen_on_the_lattice_and_nothing_elsewhere(tmp_path: Path) -> None:
    truth = plume(peak_px=0.6)
    image = lattice(truth, [(0.12, 0.02), (-0.03, 0.11)])
    seen = DybsDetector(network(tmp_path / "n.onnx")).detect(Frames(images=[image]), 0)
    size = np.linalg.norm(truth, axis=-1)
    assert (seen.llr[size > 0.3] > 2).mean() > 0.95
    assert (seen.llr[size < 0.01] > 0).mean() < 0.05
    error = np.linalg.norm(seen.displacement - truth, axis=-1)
    assert error[size > 0.3].mean() < 0.1


def test_silence_is_complete(tmp_path: Path, half_lattice: np.ndarray) -> None:
    seen = DybsDetector(network(tmp_path / "n.onnx")).detect(Frames(images=[half_lattice]), 0)
    right = seen.llr[:, 290:]
    assert not right.any()
    assert np.isinf(seen.sigma_px[:, 290:]).all()
    assert not seen.displacement[:, 290:].any()
    assert (seen.llr[:, :150] != 0).mean() > 0.99


@pytest.mark.parametrize(("wobble_px", "speaks"), [(0.0, True), (0.25, False)])
def test_straight_edges_count_unless_they_are_bent_everywhere(
    tmp_path: Path, wobble_px: float, speaks: bool
) -> None:
    rng = np.random.default_rng(1)
    wobble = cv2.GaussianBlur(rng.normal(0, 1, (128, 128, 2)), (0, 0), 8)
    image = bars(slanted(plume_before_edges(0.5) + wobble * (wobble_px / wobble.std())), PLACES)
    assert (texture_classes(image) == Texture.STRAIGHT).mean() > 0.9
    detector = DybsDetector(network(tmp_path / "n.onnx", calibration=STRAIGHT_ONLY))
    seen = detector.detect(Frames(images=[image]), 0)
    assert (seen.llr != 0).mean() == pytest.approx(float(speaks), abs=0.1)
    np.testing.assert_array_equal(np.isfinite(seen.sigma_px), seen.llr != 0)


def test_only_the_frame_itself_is_looked_at(tmp_path: Path, half_lattice: np.ndarray) -> None:
    detector = DybsDetector(network(tmp_path / "n.onnx"))
    alone = detector.detect(Frames(images=[half_lattice]), 0)
    other = np.zeros_like(half_lattice)
    among = detector.detect(Frames(images=[other, half_lattice]), 1)
    np.testing.assert_array_equal(alone.llr, among.llr)


def test_a_network_of_half_the_size_speaks_in_px_of_the_image(tmp_path: Path) -> None:
    kernels = {
        "displacement": np.full((2, 1, 1, 1), 0.3),
        "log_variance": np.zeros((1, 1, 1, 1)),
        "logit": np.ones((1, 1, 1, 1)),
    }
    image = np.random.default_rng(0).integers(254, 256, (75, 101), dtype=np.uint8)
    for scale, size in ((1, 0.3), (0.5, 0.6)):
        estimate = SingleFrameEstimator(
            convolution(tmp_path / "n.onnx", kernels, scale=scale)
        ).estimate(image)
        assert estimate.displacement.shape == (75, 101, 2)
        np.testing.assert_allclose(estimate.displacement, size, rtol=0.01)
        np.testing.assert_allclose(estimate.sigma_px, 1 / scale, rtol=0.01)


def test_joining_weighs_by_inverse_variance_where_there_is_something_to_read() -> None:
    def says(size: float, variances: list[float]) -> dict[str, np.ndarray]:
        log_variance = np.log(np.array([variances], np.float32))
        own = np.array([[0, 0, 100]], np.float32)
        displacement = np.full((1, 3, 2), size, np.float32)
        logit = np.full((1, 3), size, np.float32)
        return {
            "displacement": displacement, "log_variance": log_variance, "own": own, "logit": logit
        }  # fmt: skip

    texture = np.array([[Texture.IRREGULAR, Texture.LATTICE, Texture.STRAIGHT]], np.uint8)
    measured = measure_pattern(np.zeros((1, 3), np.uint8), texture)
    measurement = RefinedMeasurement(
        texture=texture, measured=measured, refined=says(1, [0.01, 0.01, 0.03])
    )
    estimate = combine_estimates(says(0, [0.01] * 3), measurement)
    np.testing.assert_allclose(estimate.displacement[0], [[0, 0], [1, 1], [0.25, 0.25]], atol=1e-6)
    np.testing.assert_allclose(estimate.sigma_px[0] ** 2, [0.01, 0.01, 0.0075], rtol=1e-5)
    np.testing.assert_array_equal(estimate.scores[0], [[0, 0], [0, 1], [0, 1]])


@pytest.mark.parametrize(
    ("metadata", "message"),
    [
        ({"calibration": "null"}, "not a calibration"),
        ({"calibration": {"scores": ["logit"], "classes": {}}}, "calibrate it anew"),
        ({"scale": 0}, "not a single-frame network"),
        ({"scale": "half"}, "not a single-frame network"),
    ],
)
def test_a_network_that_is_not_calibrated_says_so(
    tmp_path: Path, metadata: dict, message: str
) -> None:
    with pytest.raises(BadInputError, match=message):
        DybsDetector(network(tmp_path / "n.onnx", **metadata))


def test_a_network_of_another_kind_is_refused(tmp_path: Path) -> None:
    path = convolution(tmp_path / "n.onnx", {"displacement": np.ones((2, 1, 1, 1))})
    with pytest.raises(BadInputError, match="not a single-frame network"):
        DybsDetector(path)


def test_calibrating_writes_what_the_detector_reads(tmp_path: Path) -> None:
    pytest.importorskip("onnx")
    from detect.learning.dybs_calibration import calibrate
    from detect.synthesis import Recipe, Sources, sample_at

    path = network(tmp_path / "n.onnx", calibration="null")
    recipe = Recipe(families={"sinusoid": 1}, split="validation", peak_px=(0.3, 0.9), negatives=0.2)
    samples = [sample_at(index, recipe, Sources()) for index in range(20)]
    calibration = calibrate(path, samples)
    assert set(calibration.scales) == {"lattice"}
    assert calibration.scales["lattice"].weights[1] > 0.5
    detector = DybsDetector(path)
    seen = detector.detect(Frames(images=[samples[0].image]), 0)
    assert (seen.llr != 0).mean() > 0.9
    assert SingleFrameEstimator(path).network.name == "tiny"


@pytest.mark.parametrize(("share", "separated"), [(0.15, False), (0.05, True)])
def test_a_background_that_says_nothing_does_not_hide_among_others(
    share: float, separated: bool
) -> None:
    from detect.learning.dybs_calibration import worst_family

    rng = np.random.default_rng(0)
    families = (rng.random(20_000) < share).astype(int)
    labels = rng.random(20_000) < 0.1
    llr = np.where(families == 0, 3.0 * labels, 0) + rng.normal(0, 1, 20_000)
    assert (worst_family(llr, labels, families) > 0.6) == separated


def test_the_network_runs_only_where_a_class_may_have_evidence(
    tmp_path: Path, half_lattice: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> None:
    detector = DybsDetector(network(tmp_path / "n.onnx"))
    noise = np.ascontiguousarray(half_lattice[:, 290:])
    expected = detector.to_detection(detector.estimator.estimate(noise))
    runs = []
    monkeypatch.setattr(detector.estimator, "network_maps", runs.append)
    seen = detector.detect(Frames(images=[noise]), 0)
    assert not runs
    for name in ("displacement", "sigma_px", "llr"):
        np.testing.assert_array_equal(getattr(seen, name), getattr(expected, name))
    with pytest.raises(TypeError):
        detector.detect(Frames(images=[half_lattice]), 0)
    assert len(runs) == 1
