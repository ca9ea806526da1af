import numpy as np
import pytest

from geometry.covariance import (
    principal_sigmas,
    sigma_along,
    split_information,
    standard_deviations,
)


def test_what_rounding_made_negative_counts_as_zero() -> None:
    lost = np.diag([-1e-20, 4.0])
    np.testing.assert_array_equal(standard_deviations(lost), [0.0, 2.0])
    np.testing.assert_array_equal(principal_sigmas(-1e-20 * np.eye(3)), [0.0, 0.0, 0.0])
    assert sigma_along(lost, np.array([1.0, 0.0])) == 0.0


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_direction_that_is_lost_in_rounding_is_free_whatever_its_sign(sign: float) -> None:
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    information = turn @ np.diag([4.0, 1.0, sign * 1e-17]) @ turn.T
    inverse, free = split_information(information)
    assert free.shape == (3, 1)
    assert abs(free[:, 0] @ turn[:, 2]) / np.linalg.norm(free) == pytest.approx(1.0)
    np.testing.assert_allclose(information @ inverse @ information, information, atol=1e-9)


def test_units_do_not_decide_what_is_free() -> None:
    units = np.diag([1e9, 1.0, 1e-9])
    information = units @ np.array([[2.0, 0.5, 0.1], [0.5, 1.0, 0.2], [0.1, 0.2, 3.0]]) @ units
    inverse, free = split_information(information)
    assert free.shape == (3, 0)
    scaled = units @ inverse @ units
    np.testing.assert_allclose(
        scaled @ (np.linalg.inv(units) @ information @ np.linalg.inv(units)), np.eye(3), atol=1e-9
    )
