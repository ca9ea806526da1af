"""Scenes that several tests of this floor film once."""

import pytest

from tests.detect.scenes import TwoWalls, two_walls


@pytest.fixture(scope="session")
def walls_with_plume() -> TwoWalls:
    return two_walls(peak_px=0.6)


@pytest.fixture(scope="session")
def walls_without_plume() -> TwoWalls:
    return two_walls(peak_px=0.0, sky=True)
