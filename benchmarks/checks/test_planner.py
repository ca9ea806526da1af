"""What is planned against what the simulator shows."""

import numpy as np
import pytest

from benchmarks.planner.straight import SETUPS, ratio_to_simulated


@pytest.mark.parametrize("number", range(3))
def test_a_random_set_up_is_as_the_simulator_shows_it(number: int) -> None:
    assert ratio_to_simulated(number) == pytest.approx(1, abs=0.1)


@pytest.mark.slow
def test_thirty_random_set_ups_are_as_the_simulator_shows_them() -> None:
    ratios = [ratio_to_simulated(number) for number in range(SETUPS)]
    assert np.abs(np.array(ratios) - 1).max() < 0.1
