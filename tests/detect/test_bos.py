import pickle
from pathlib import Path

import cv2
import numpy as np
import pytest
import scipy.io

from detect.bos import BosDetector, temporal_median, texture_of, unbiased_flow
from detect.detection import Frames
from detect.differential import horn_schunck
from detect.flow import flow_method
from detect.scores import auroc
from geometry.errors import BadInputError
from tests.detect.scenes import Texture, photographed, ring_displacement

SHAPE = (120, 160)


def still_camera(count: int, *, shake_px: float = 0.0) -> tuple[Frames, np.ndarray]:
    """The plume stands in the last frame only, the camera shakes in every one."""
    texture = Texture(3, 1.2)
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    lens = ring_displacement(SHAPE, 0.4, 12.0)
    rng = np.random.default_rng(0)
    images = []
    for i in range(count):
        w = (lens if i == count - 1 else 0 * lens) + shake_px * rng.normal(size=2)
        images.append(photographed(texture(x + w[..., 0], y + w[..., 1]), seed=i))
    return Frames(images=images), lens


@pytest.mark.parametrize("shake_px", [0.0, 0.1])
def test_a_still_camera_sees_the_plume_against_the_median(shake_px: float) -> None:
    frames, lens = still_camera(9, shake_px=shake_px)
    detection = BosDetector().detect(frames, 8)
    plume = np.linalg.norm(lens, axis=-1) > 0.2
    error = np.linalg.norm(detection.displacement - lens, axis=-1)
    assert error[plume].mean() < 0.08
    assert np.median(error[~plume]) < 0.06
    assert auroc(detection.llr, plume) > 0.95
    assert detection.llr[plume].mean() > 1


def test_a_frame_without_plume_gives_no_evidence() -> None:
    frames, _ = still_camera(9)
    detection = BosDetector().detect(frames, 4)
    assert (detection.llr > 1).mean() < 0.01
    assert detection.llr.mean() < 0


def test_sigma_is_honest() -> None:
    frames, _ = still_camera(9)
    detection = BosDetector(flow="lucas-kanade").detect(frames, 4)
    nees = (detection.displacement**2).sum(axis=-1) / detection.sigma_px**2
    assert 0.7 < np.median(nees) / (2 * np.log(2)) < 1.6


def test_a_given_reference_needs_one_frame() -> None:
    frames, lens = still_camera(2)
    detector = BosDetector(flow="dis", reference=frames.images[0])
    detection = detector.detect(Frames(images=frames.images[1:]), 0)
    plume = np.linalg.norm(lens, axis=-1) > 0.2
    assert (detection.displacement * lens)[plume].sum() > 0.8 * (lens[plume] ** 2).sum()


def test_the_temporal_median_reads_no_more_frames_than_asked() -> None:
    class Counting(list[np.ndarray]):
        reads = 0

        def __getitem__(self, row):  # type: ignore[no-untyped-def]
            Counting.reads += 1
            return super().__getitem__(row)

    images = Counting([np.full((4, 4), i % 7, np.uint8) for i in range(1000)])
    assert temporal_median(images, 11).shape == (4, 4)
    assert Counting.reads == 11


def test_two_frames_make_no_reference() -> None:
    frames, _ = still_camera(2)
    with pytest.raises(BadInputError, match="at least 3 frames, got 2"):
        BosDetector().detect(frames, 0)


def test_sizes_must_agree() -> None:
    frames, _ = still_camera(1)
    with pytest.raises(BadInputError, match="of one size"):
        BosDetector(reference=frames.images[0][:50]).detect(frames, 0)


def test_a_lattice_does_not_lead_the_flow_whole_periods_astray() -> None:
    y, x = np.mgrid[:256, :256].astype(float)
    lens = ring_displacement((256, 256), 0.5, 40.0)

    def board(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        waves = np.sin(2 * np.pi * (x + 0.05 * y) / 12) * np.sin(2 * np.pi * (y - 0.05 * x) / 12)
        return 128 + 60 * np.clip(4 * waves, -1, 1)

    shake = np.array([0.1, 0.2])
    reference = photographed(board(x, y), seed=1)
    u, v = np.moveaxis(lens + shake, -1, 0)
    image = photographed(board(x + u, y + v), seed=2)
    flow, bias_px = unbiased_flow(horn_schunck, reference, image, texture_of(reference))
    assert np.abs(bias_px - shake).max() < 0.03
    assert np.linalg.norm(flow - lens, axis=-1).mean() < 0.04


@pytest.fixture
def blowtorch(shared_data: Path) -> tuple[np.ndarray, np.ndarray, list[np.ndarray]]:
    """Reference, image and the authors' u and v in our sign: theirs leads the other way."""
    folder = shared_data / "1_bos_pairs/blowtorch_plume"
    reference, image = (
        cv2.imread(str(folder / f"sop_enc_test_{k}.tif"), cv2.IMREAD_GRAYSCALE)
        for k in ("000", "001")
    )
    piv = [
        -scipy.io.loadmat(str(folder / f"{name}_PIV_sop_enc_test.mat"))[f"{name}_original"].item(0)
        for name in "uv"
    ]
    return reference, image, [field - np.median(field) for field in piv]


@pytest.mark.parametrize("method", ["horn-schunck", "dis"])
def test_the_blowtorch_plume_agrees_with_the_authors_piv(method: str, blowtorch: tuple) -> None:
    # windows every 8 px, the first at 8; a part of 640 x 400 px over the plume's edge
    reference, image, piv = blowtorch
    top, left, height, width = 400, 1000, 400, 640
    part = np.s_[top : top + height, left : left + width]
    reference, image = reference[part].copy(), image[part].copy()
    flow, _ = unbiased_flow(flow_method(method), reference, image, texture_of(reference))
    for axis, field in enumerate(piv):
        ours = cv2.GaussianBlur(flow[..., axis], (0, 0), 4)[::8, ::8]
        theirs = field[top // 8 - 1 :, left // 8 - 1 :][: ours.shape[0], : ours.shape[1]]
        known = np.abs(theirs) < 6
        assert np.corrcoef(ours[known], theirs[known])[0, 1] > 0.95
        slope = np.polyfit(theirs[known], ours[known], 1)[0]
        assert 0.9 < slope < 1.2


@pytest.mark.parametrize(
    ("pair", "sign"),
    [("blowtorch_plume/sop_enc_test_{:03}.tif", 1), ("supersonic_jet/A{:03}.tif", -1)],
    ids=["hot plume", "cold dense jet"],
)
def test_light_is_bent_away_from_hot_gas_and_towards_cold(
    pair: str, sign: int, shared_data: Path
) -> None:
    paths = [str(shared_data / "1_bos_pairs" / pair.format(k)) for k in (0, 1)]
    reference, image = (cv2.imread(path, cv2.IMREAD_GRAYSCALE) for path in paths)
    flow, _ = unbiased_flow(flow_method("dis"), reference, image, texture_of(reference))
    u = cv2.GaussianBlur(flow[..., 0], (0, 0), 4)
    x = np.arange(u.shape[1])
    from_middle = x - (np.abs(u) @ x / np.abs(u).sum(axis=1))[:, None]
    bent = np.abs(u) > 0.3
    assert sign * np.corrcoef(u[bent], from_middle[bent])[0, 1] > 0.6


def test_reading_the_authors_files_unpickles_nothing(
    shared_data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("unpickled")

    for name in ("load", "loads", "Unpickler"):
        monkeypatch.setattr(pickle, name, refuse)
    path = shared_data / "1_bos_pairs/blowtorch_plume/u_PIV_sop_enc_test.mat"
    assert scipy.io.loadmat(str(path))["u_original"].item(0).shape == (137, 336)
