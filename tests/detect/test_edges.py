import cv2
import numpy as np
import pytest
from scipy.special import erf

from detect.dybs.edge_points import estimate_camera_noise
from detect.dybs.edge_reliability import select_edges
from detect.dybs.edges import measure_edges

SHAPE = (128, 128)
SOFT_PX = 0.6


def grid(shape: tuple[int, int] = SHAPE) -> np.ndarray:
    y, x = np.mgrid[: shape[0], : shape[1]].astype(float)
    return np.stack([x, y], axis=-1)


def plume(peak_px: float, sigma_px: float = 9.0) -> np.ndarray:
    """The slope of a bump in the middle, a fifth of the image wide."""
    at = grid() - 64.3
    bump = np.exp(-(at**2).sum(axis=-1) / (2 * sigma_px**2)) * np.exp(0.5) / sigma_px
    return at * (peak_px * bump)[..., None]


def bars(across: np.ndarray, places: list[float], noise: float = 0.5) -> np.ndarray:
    """Soft edges, up and down in turn, where `across` (px) is at `places`."""
    signs = [1 if k % 2 else -1 for k in range(len(places))]
    edges = (s * erf((across - at) / SOFT_PX) for s, at in zip(signs, places, strict=True))
    grey = 120 + 50 * sum(edges) + np.random.default_rng(0).normal(0, noise, across.shape)
    return grey.round().clip(0, 255).astype(np.uint8)


def slanted(displacement: np.ndarray, tilt: float = 0.13) -> np.ndarray:
    """How far p + displacement(p) lies across lines that are `tilt` off the upright."""
    seen = grid() + displacement
    return (seen[..., 0] - tilt * seen[..., 1]) / np.hypot(1, tilt)


@pytest.mark.parametrize("transposed", [False, True])
def test_a_bent_edge_gives_the_displacement_across_it_with_its_sign(transposed: bool) -> None:
    truth = plume(0.8)
    image = bars(slanted(truth), [25.0, 45.0, 66.0])
    found = measure_edges(image.T if transposed else image)
    if transposed:
        found = found.transpose(1, 0, 2)[..., [1, 0, 3, 2, 6, 5, 4, 7]]
    normal = np.array([1, -0.13]) / np.hypot(1, 0.13)
    across, measured = truth[::2, ::2] @ normal, found[..., :2] @ normal
    certain = found[..., 4] + found[..., 6]
    known = (np.abs(across) > 0.2) & (certain > 0.5 * certain.max())
    assert known.sum() > 30
    assert np.corrcoef(measured[known], across[known])[0, 1] > 0.95


def test_straight_edges_stand_still_and_the_rest_is_unknown() -> None:
    found = measure_edges(bars(slanted(np.zeros((*SHAPE, 2))), [40.0, 80.0]))
    certain = found[..., 4] + found[..., 6]
    assert np.linalg.norm(found[..., :2], axis=-1)[certain > 100].mean() < 0.03
    assert not found[..., :4][certain == 0].any()
    far = np.abs(slanted(np.zeros((*SHAPE, 2)))[::2, ::2] - 10) < 4
    assert certain[far].max() < 1


def test_nothing_is_known_along_an_edge() -> None:
    found = measure_edges(bars(slanted(np.zeros((*SHAPE, 2))), [60.0]))
    xx, xy, yy = np.moveaxis(found[..., 4:7], -1, 0)
    known = xx + yy > 100
    determinant = (xx * yy - xy**2)[known]
    assert (determinant < 0.01 * (xx + yy)[known] ** 2).all()


def test_an_edge_that_is_turned_shows_against_the_pencil_of_the_others() -> None:
    """Off its own line it is straight; off those of its neighbours it is not."""
    y = grid()[..., 1] - 63.5
    across = grid()[..., 0] - 0.0008 * y * (grid()[..., 0] - 20)
    turned = across + np.where(np.abs(across - 70) < 8, 0.006 * y, 0)
    found = measure_edges(bars(turned, [15.0, 30.0, 45.0, 70.0, 95.0, 110.0]))
    near = np.abs(across[::2, ::2] - 70) < 2
    ends = near & (np.abs(y[::2, ::2]) > 35) & (np.abs(y[::2, ::2]) < 55)
    slope = (y[::2, ::2] * 0.006)[ends]
    shared, own = (found[..., k][ends] for k in (0, 2))
    assert np.corrcoef(shared, slope)[0, 1] > 0.95
    assert np.abs(own).mean() < 0.3 * np.abs(shared).mean()


PLACES = [*np.arange(6.0, 122, 9)]


def reliable_share(image: np.ndarray) -> float:
    """The share of an image whose straight edges are reliable."""
    return float(measure_edges(image)[..., 8].mean())


@pytest.mark.parametrize("peak_px", [0.0, 0.9])
def test_parallel_edges_are_reliable_also_behind_a_plume(peak_px: float) -> None:
    assert reliable_share(bars(slanted(plume(peak_px)), PLACES)) > 0.99


@pytest.mark.parametrize("noise", [0.5, 2.0])
def test_what_is_bent_everywhere_is_unreliable(noise: float) -> None:
    wobble = cv2.GaussianBlur(np.random.default_rng(1).normal(0, 1, (*SHAPE, 2)), (0, 0), 8)
    wobble *= 0.25 / wobble.std()
    assert reliable_share(bars(slanted(wobble), PLACES, noise)) < 0.05


def test_rough_edges_are_unreliable() -> None:
    rough = cv2.GaussianBlur(np.random.default_rng(1).normal(0, 1, (*SHAPE, 2)), (0, 0), 1.5)
    rough *= 0.08 / rough.std()
    assert reliable_share(bars(slanted(rough), PLACES)) < 0.01


def test_edges_that_cross_are_unreliable() -> None:
    across = grid()[..., 0] + 0.1 * grid()[..., 1]
    down = grid()[..., 1] - 0.1 * grid()[..., 0]
    fence = bars(across, PLACES).astype(float) + bars(down, PLACES) - 128
    assert reliable_share(fence.clip(0, 255).astype(np.uint8)) < 0.01


@pytest.mark.parametrize("shape", [(1, 3), (17, 33), (129, 131), (64, 300)])
def test_any_size(shape: tuple[int, int]) -> None:
    image = np.random.default_rng(0).integers(0, 256, shape, dtype=np.uint8)
    found = measure_edges(image)
    assert found.shape == ((shape[0] + 1) // 2, (shape[1] + 1) // 2, 9)
    assert np.isfinite(found).all()


def test_an_image_without_edges() -> None:
    assert not measure_edges(np.full(SHAPE, 90, np.uint8)).any()


def test_the_noise_is_the_cameras() -> None:
    rng = np.random.default_rng(0)
    image = 100 + 0.2 * grid()[..., 0] + rng.normal(0, 2.0, SHAPE)
    assert estimate_camera_noise(image.astype(np.float32)) == pytest.approx(2.1, rel=0.1)


def test_straight_edges_count_in_broad_reliable_areas_and_close_to_them() -> None:
    straight, reliable, waves = np.zeros((3, 200, 400), dtype=bool)
    straight[:, :300] = True
    reliable[:, 10:37] = reliable[80:108, 100:128] = reliable[95:97, 128:150] = True
    expected = np.zeros_like(straight)
    expected[72:116, 92:136] = expected[87:105, 136:158] = True
    found = select_edges(straight, reliable, waves)
    np.testing.assert_array_equal(found, expected)
    assert not select_edges(straight, np.zeros_like(reliable), waves).any()


def test_waves_beside_them_make_a_place_broad() -> None:
    straight, reliable, waves = np.zeros((3, 64, 128), dtype=bool)
    straight[:, :20] = reliable[:, :20] = waves[:, 20:40] = True
    np.testing.assert_array_equal(select_edges(straight, reliable, waves), straight)
    assert not select_edges(straight, reliable, np.roll(waves, 20, axis=1)).any()
