"""The benchmark of the leak makes twins that differ by the warp alone."""

from pathlib import Path

import cv2
import numpy as np
import pytest

pytest.importorskip("torch")

from benchmarks.warp_leak import networks, table, twins
from detect.synthesis import Sample, shards_in

SEEDS = 12


@pytest.fixture
def photo(tmp_path: Path) -> Path:
    """Fine random detail, everywhere alike."""
    grain = np.random.default_rng(0).normal(128, 60, (640, 640)).astype(np.float32)
    image = cv2.GaussianBlur(grain, (0, 0), 1.5)
    image = np.clip(128 + 40 * (image - image.mean()) / image.std(), 0, 255).astype(np.uint8)
    path = tmp_path / "grain.png"
    cv2.imwrite(str(path), image)
    return path


@pytest.fixture
def pairs(photo: Path) -> list[dict[str, Sample]]:
    return [twins.twins(np.random.default_rng([4, i]), photo, ()) for i in range(SEEDS)]


def detail(image: np.ndarray) -> float:
    grey = image.astype(np.float32)
    return float(((grey - cv2.GaussianBlur(grey, (0, 0), 0.8)) ** 2).mean())


def test_twins_share_scene_and_truth(pairs: list[dict[str, Sample]]) -> None:
    with_plume = 0
    for pair in pairs:
        camera, bilinear = pair["camera"], pair["bilinear"]
        assert np.array_equal(camera.displacement, bilinear.displacement)
        still = np.linalg.norm(camera.displacement, axis=-1) < 1e-4
        with_plume += not still.all()
        assert np.corrcoef(camera.image.ravel(), bilinear.image.ravel())[0, 1] > 0.5
    assert 0 < with_plume < SEEDS


def test_only_the_bilinear_twin_loses_detail_when_it_moves(photo: Path) -> None:
    details = {
        px: {way: detail(image) for way, image in twins.shifted(photo, 1, px).items()}
        for px in table.SHIFTS_PX
    }
    assert details[0.0]["bilinear"] == details[0.0]["camera"]
    assert details[0.5]["bilinear"] < 0.8 * details[0.0]["bilinear"]
    assert details[0.5]["camera"] == pytest.approx(details[0.0]["camera"], rel=0.05)


def test_noise_after_the_warp_has_its_size() -> None:
    grey = np.full((96, 96), 128, np.uint8)
    noise = twins.noisy(grey, 3).astype(float) - 128
    assert noise.std() == pytest.approx(twins.NOISE_AFTER, rel=0.05)
    assert not np.array_equal(twins.noisy(grey, 3), twins.noisy(grey, 4))


def test_blur_is_learnt_from_warped_photos_alone(
    photo: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(networks, "STEPS", 300)
    twins.write(tmp_path / "train", [photo], (), 40, seed=0)
    twins.write(tmp_path / "test", [photo], (), 24, seed=1)
    strong = {}
    for way in twins.WAYS:
        ask = networks.perceptron(tmp_path / f"train-{way}")
        samples = [s for shard in shards_in(tmp_path / f"test-{way}")
                   for s in map(shard.sample_at, range(len(shard)))]  # fmt: skip
        maps = [ask(sample.image) for sample in samples]
        score, said = (np.array(each) for each in zip(*maps, strict=True))
        sizes = np.array([np.linalg.norm(s.displacement, axis=-1) for s in samples])
        everything = {"all": np.ones(len(samples), dtype=bool)}
        strong[way] = float(table.score_answers(score, said, sizes, everything)[1])
    assert strong["bilinear"] > 0.8
    assert 0.35 < strong["camera"] < 0.65


@pytest.mark.parametrize("kind", networks.UNETS)
def test_a_unet_is_trained_once_and_answers_at_the_images_size(
    photo: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    twins.write(tmp_path / "train", [photo], (), 4, seed=0)
    image = np.random.default_rng(0).integers(0, 256, (96, 96), dtype=np.uint8)
    first = networks.unet(kind, tmp_path / "train-camera", 2)(image)
    monkeypatch.setattr(networks, "train", None)
    again = networks.unet(kind, tmp_path / "train-camera", 2)(image)
    for one, other in zip(first, again, strict=True):
        assert one.shape == image.shape
        np.testing.assert_array_equal(one, other)
    assert 0 < first[0].min() <= first[0].max() < 1
