from dataclasses import replace

import cv2
import numpy as np
import pytest

from detect.detection import Detection
from detect.information import DisplacementInformation
from detect.registered import RegisteredDetector
from detect.registered.information import (
    COMMON_SHARE,
    RegisteredFrames,
    displacement_information,
)
from detect.warp import sample
from geometry.errors import BadInputError
from geometry.npz import read_npz, save_arrays
from tests.detect.scenes import TwoWalls, two_walls


def of_displacement(w: np.ndarray, matrix: np.ndarray) -> DisplacementInformation:
    """What pixels say that measured w exactly, each with its own precision."""
    xx, xy, yy = np.moveaxis(matrix, -1, 0)
    x, y = np.moveaxis(w, -1, 0)
    vector = np.stack([xx * x + xy * y, xy * x + yy * y], axis=-1)
    return DisplacementInformation(
        vector=vector.astype(np.float32), matrix=matrix.astype(np.float32)
    )


def random_matrix(rng: np.random.Generator, shape: tuple[int, int]) -> np.ndarray:
    gx, gy = rng.normal(size=(2, *shape))
    return np.stack([gx * gx, gx * gy, gy * gy], axis=-1)


def size_of(information: DisplacementInformation, shape: np.ndarray) -> float:
    """The size of a displacement of that shape, by least squares."""
    x, y = np.moveaxis(shape, -1, 0)
    xx, xy, yy = np.moveaxis(information.matrix, -1, 0)
    score = (shape * information.vector).sum()
    return float(score / (x * x * xx + 2 * x * y * xy + y * y * yy).sum())


def test_cells_hold_what_their_pixels_said() -> None:
    rng = np.random.default_rng(0)
    fine = of_displacement(rng.normal(size=(24, 36, 2)), random_matrix(rng, (24, 36)))
    coarse = fine.summed_to(12, 8)
    for name in ("vector", "matrix"):
        maps = getattr(fine, name)
        sums = maps.reshape(8, 3, 12, 3, -1).sum(axis=(1, 3))
        np.testing.assert_allclose(getattr(coarse, name), sums, rtol=1e-4, atol=1e-4)


def test_what_surroundings_share_goes_and_a_turn_stays() -> None:
    rng = np.random.default_rng(1)
    x = (np.arange(160) - 80) / 5
    turn = np.zeros((120, 160, 2))
    turn[..., 0] = x * np.exp(-(x**2) / 2)
    shared = np.full_like(turn, 0.4)
    information = of_displacement(0.1 * turn + shared, random_matrix(rng, turn.shape[:2]))
    cleaned = information.without_local_mean(20.0)
    assert abs(size_of(information, shared)) > 0.9
    assert abs(size_of(cleaned, shared)) < 0.05
    assert size_of(cleaned, turn) == pytest.approx(0.1, rel=0.2)


def test_shapes_must_go_together() -> None:
    with pytest.raises(ValueError, match="do not go together"):
        DisplacementInformation(
            vector=np.zeros((4, 5, 2), np.float32), matrix=np.zeros((4, 6, 3), np.float32)
        )


def registered(texture: np.ndarray, w: np.ndarray, noise: list[float]) -> RegisteredFrames:
    """A key frame whose texture is displaced by w (H, W, 2), and still neighbours on both sides.

    Args:
        texture: (H, W) grey levels.
        w: px.
        noise: Standard deviation of each neighbour's, grey levels; the key frame has 1.
    """
    rng = np.random.default_rng(8)
    y, x = np.mgrid[: len(texture), : texture.shape[1]].astype(np.float32)
    key = sample(texture, np.stack([x, y], axis=-1) + w)
    slopes = np.zeros((len(noise), 2, *texture.shape), np.float32)
    slopes[:, 0] = np.linspace(-20, 20, len(noise))[:, None, None]
    neighbours = [texture + sigma * rng.normal(size=texture.shape) for sigma in noise]
    return RegisteredFrames(
        key=(key + rng.normal(size=key.shape)).astype(np.float32),
        neighbours=np.array(neighbours, np.float32),
        slopes=slopes,
        visible=np.ones_like(slopes[:, 0]),
        depth_edge_px=np.zeros_like(texture),
    )


def random_texture(finest_px: float) -> np.ndarray:
    white = np.random.default_rng(2).normal(size=(240, 640))
    texture = cv2.GaussianBlur(white, (0, 0), finest_px)
    return np.asarray(127 + 25 * texture / texture.std(), np.float32)


def column_turn(size_px: float) -> np.ndarray:
    x = (np.arange(640) - 320) / 12
    turn = np.zeros((240, 640, 2), np.float32)
    turn[..., 0] = size_px * x * np.exp(-(x**2) / 2)
    return turn


@pytest.mark.parametrize(("finest_px", "blurred"), [(1.0, False), (3.0, True)])
def test_blurred_frames_and_sharp_ones_tell_the_size_in_the_same_px(
    finest_px: float, blurred: bool
) -> None:
    turn = column_turn(0.3)
    frames = registered(random_texture(finest_px), turn, [1.0] * 6)
    assert frames.blurred is blurred
    information = displacement_information(frames)
    coarse = cv2.resize(turn, (320, 120), interpolation=cv2.INTER_AREA)
    exact = of_displacement(coarse, information.matrix).without_local_mean(COMMON_SHARE * 320)
    size = (coarse * information.vector).sum() / (coarse * exact.vector).sum()
    assert size == pytest.approx(1, abs=0.15)


def test_a_neighbour_that_errs_counts_for_little() -> None:
    texture, still = random_texture(1.0), column_turn(0.0)
    without, with_it = (
        displacement_information(registered(texture, still, noise)).matrix[..., 0].sum()
        for noise in ([1.0] * 6, [1.0] * 5 + [40.0])
    )
    assert with_it > 0.5 * without


def test_pixels_that_one_side_of_the_path_hides_do_not_count() -> None:
    frames = registered(random_texture(1.0), column_turn(0.0), [1.0] * 8)
    frames.visible[4:, :, :80] = 0
    known = displacement_information(frames).matrix[..., 0].mean(axis=0)
    assert known[:38].max() < 0.02 * known[42:].min()


def test_neighbours_that_all_lie_on_one_side_tell_what_they_can() -> None:
    frames = registered(random_texture(1.0), column_turn(0.0), [1.0] * 8)
    one_sided = replace(frames, slopes=frames.slopes + np.float32(25))
    both, one = (displacement_information(each).matrix[..., 0] for each in (frames, one_sided))
    assert one.mean() > 0.5 * both.mean()


def share_measured(scene: TwoWalls, truth: np.ndarray) -> float:
    """Measured over true displacement, both without what surroundings share."""
    information = RegisteredDetector().detect(scene.frames, scene.key).information
    assert information is not None
    exact = of_displacement(truth, information.matrix)
    exact = exact.without_local_mean(COMMON_SHARE * truth.shape[1])
    return float((truth * information.vector).sum() / (truth * exact.vector).sum())


def test_a_weak_plume_keeps_as_much_of_its_size_as_a_strong_one() -> None:
    weak, strong = (
        share_measured(scene, scene.displacement)
        for scene in (two_walls(peak_px=0.15), two_walls(peak_px=0.6))
    )
    assert 0.6 < weak < 1.2
    assert weak == pytest.approx(strong, abs=0.1)


def test_still_air_has_no_size(walls_without_plume: TwoWalls) -> None:
    plume = two_walls(peak_px=0.15).displacement
    assert abs(share_measured(walls_without_plume, plume)) < 0.25


def test_a_file_holds_the_information(tmp_path, walls_with_plume: TwoWalls) -> None:
    detection = RegisteredDetector().detect(walls_with_plume.frames, walls_with_plume.key)
    detection.save(tmp_path / "a.npz")
    loaded = Detection.load(tmp_path / "a.npz").information
    assert detection.information is not None
    assert loaded is not None
    np.testing.assert_array_equal(loaded.vector, detection.information.vector)
    np.testing.assert_array_equal(loaded.matrix, detection.information.matrix)
    replace(detection, information=None).save(tmp_path / "b.npz")
    assert Detection.load(tmp_path / "b.npz").information is None
    arrays = read_npz(tmp_path / "a.npz")
    del arrays["information_matrix"]
    save_arrays(tmp_path / "c.npz", **arrays)
    with pytest.raises(BadInputError, match=r"c\.npz: not a detection \(of the information"):
        Detection.load(tmp_path / "c.npz")
