import cv2
import numpy as np

from detect.detection import Detection
from detect.evidence import LLR_MAX, LLR_MIN, log_likelihood_ratio
from detect.haze import Haze
from geometry.arrays import GreyImage
from geometry.camera import Camera
from locate.fusion.still_camera.bearings import StillCameraResult, find_bearings
from locate.fusion.still_camera.temporal_coherence import EVERYWHERE, TOO_SLOW
from tests.detect.fluctuating import frames

CAMERA = Camera.pinhole(160, 120, 150.0)


def detection(rng: np.random.Generator, plume: bool) -> Detection:
    llr = rng.normal(-0.4, 0.5, (120, 160)).astype(np.float32)
    if plume:
        axes = (6 + int(rng.integers(3)), 25)
        cv2.ellipse(llr, (100 + int(rng.integers(-3, 4)), 60), axes, 0, 0, 360, 2.0, -1)
    llr = cv2.GaussianBlur(llr, (0, 0), 1.5)
    displacement = np.zeros((120, 160, 2), np.float32)
    displacement[..., 0] = np.maximum(llr, 0)
    return Detection(displacement=displacement, sigma_px=np.ones_like(llr), llr=llr)


def test_plume_before_a_still_camera_gives_the_direction_of_its_base() -> None:
    rng = np.random.default_rng(0)
    (bearing,) = find_bearings([detection(rng, True) for _ in range(10)], CAMERA).bearings
    x, y = CAMERA.project(bearing.direction_in_cam)
    assert abs(x - 100) < 4
    assert 75 < y < 92
    assert bearing.probability > 0.99
    assert 0 < bearing.sigma_rad < 0.1


def test_noise_alone_gives_no_direction() -> None:
    rng = np.random.default_rng(1)
    assert find_bearings([detection(rng, False) for _ in range(10)], CAMERA).bearings == ()


def in_time(images: list[GreyImage]) -> StillCameraResult:
    rng = np.random.default_rng(2)
    silent = [detection(rng, False) for _ in range(10)]
    return find_bearings(silent, CAMERA, consecutive=images)


def test_what_no_single_frame_shows_is_found_in_time() -> None:
    found = in_time(frames(0.15))
    (bearing,) = found.bearings
    x, y = CAMERA.project(bearing.direction_in_cam)
    assert abs(x - 102) < 4
    assert abs(y - 90) < 5
    assert bearing.displacement_px < 0.15
    assert found.notes == ()


def test_noise_in_time_gives_no_direction() -> None:
    found = in_time(frames(0.0))
    assert (found.bearings, found.notes) == ((), ())


def test_a_note_states_why_time_shows_nothing() -> None:
    assert in_time(frames(0.15, count=12)).notes == (TOO_SLOW,)
    held = in_time(frames(0.15, held=4))
    assert (held.bearings, held.notes) == ((), (EVERYWHERE,))


def test_what_oscillates_is_left_out_with_a_note() -> None:
    found = in_time(frames(0.3, springs=True))
    assert found.bearings == ()
    assert found.notes[0].startswith("One place moves to and fro")


def test_before_haze_only_what_moves_far_more_is_a_plume() -> None:
    rng = np.random.default_rng(0)
    seen = [detection(rng, True) for _ in range(10)]
    (usual,) = find_bearings(seen, CAMERA).bearings
    for share, count in ((0.2, 1), (0.5, 0)):
        haze = Haze(rms_px=share * usual.displacement_px, cells_px=())
        assert len(find_bearings(seen, CAMERA, haze=haze).bearings) == count


def test_of_a_shaken_camera_single_frames_show_what_moves_further() -> None:
    rng = np.random.default_rng(0)
    seen = [detection(rng, True) for _ in range(10)]
    (usual,) = find_bearings(seen, CAMERA).bearings
    assert find_bearings(seen, CAMERA, shaking_px=0.6 * usual.displacement_px).bearings
    found = find_bearings(seen, CAMERA, shaking_px=0.7 * usual.displacement_px)
    assert found.bearings == ()
    assert "one place that moves the image less" in found.notes[-1]


def measured(rng: np.random.Generator, sigma_px: float, plume_px: float = 0.0) -> Detection:
    """A frame in which everything was measured to `sigma_px`, with a plume across the middle."""
    displacement = rng.normal(0, sigma_px, (120, 160, 2)).astype(np.float32)
    cv2.rectangle(displacement, (76, 40), (84, 72), (plume_px, 0.0), -1)
    sigma = np.full((120, 160), sigma_px, np.float32)
    size_px = np.hypot(*np.moveaxis(displacement, -1, 0))
    llr = np.clip(log_likelihood_ratio(size_px, sigma), LLR_MIN, LLR_MAX)
    return Detection(displacement=displacement, sigma_px=sigma, llr=llr)


def test_a_plume_of_the_limit_is_found_and_a_far_weaker_one_is_not() -> None:
    rng = np.random.default_rng(3)
    limits = []
    for sigma_px in (0.05, 0.2):
        empty = find_bearings([measured(rng, sigma_px) for _ in range(10)], CAMERA)
        assert empty.bearings == ()
        assert empty.limit_px is not None
        limits.append(empty.limit_px)
        for share, count in ((1.3, 1), (0.3, 0)):
            seen = [measured(rng, sigma_px, share * empty.limit_px) for _ in range(10)]
            assert len(find_bearings(seen, CAMERA).bearings) == count
    assert limits[0] < limits[1]


def test_without_evidence_there_is_no_limit() -> None:
    silent = [Detection.without_evidence((120, 160)) for _ in range(10)]
    assert find_bearings(silent, CAMERA).limit_px is None


def test_noise_of_a_coarse_codec_leaves_no_limit() -> None:
    rng = np.random.default_rng(3)
    seen, held = [measured(rng, 0.05) for _ in range(10)], frames(0.0, held=4)
    fine, coarse, calm = (
        find_bearings(seen, CAMERA, consecutive=images, coarse_coding=coding)
        for images, coding in ((held, False), (held, True), (frames(0.0), True))
    )
    assert EVERYWHERE in fine.notes
    assert fine.limit_px is not None
    assert coarse.limit_px is None
    assert calm.limit_px is not None
