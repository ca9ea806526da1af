import numpy as np

from detect.registered.features import FEATURES, stack_features
from detect.registered.registration import Measurement

SHAPE = (4, 5)


def measurement(w: tuple[float, float]) -> Measurement:
    one = np.ones(SHAPE, np.float32)
    field = np.broadcast_to(np.float32(w), (*SHAPE, 2))
    return Measurement(
        displacement=field, first_displacement=field / 2, misfit=one, scatter_px=0.1 * one,
        variance_factor=one, visible=8 * one, one_sidedness=one, texture=one,
        relative_inverse_depth=one, depth_edge_px=0 * one,
    )  # fmt: skip


def channel(name: str, maps: np.ndarray) -> float:
    return float(maps[FEATURES.index(name), 0, 0])  # type: ignore[arg-type]


def test_displacements_keep_their_sign_and_are_compressed() -> None:
    sigma = np.full(SHAPE, 0.05, np.float32)
    maps = stack_features(measurement((0.1, -2.0)), sigma)
    assert maps.shape == (len(FEATURES), *SHAPE)
    assert channel("displacement_x", maps) == np.float32(np.arcsinh(1.0))
    assert -4 < channel("displacement_y", maps) < -3
    assert channel("first_displacement_x", maps) < channel("displacement_x", maps)
    assert channel("significance_x", maps) == np.float32(np.arcsinh(2.0))


def test_what_is_unmeasured_is_finite_and_insignificant() -> None:
    maps = stack_features(measurement((0.3, 0.0)), np.full(SHAPE, np.inf, np.float32))
    assert np.isfinite(maps).all()
    assert abs(channel("significance_x", maps)) < 0.11
    assert channel("log_sigma", maps) > 3
