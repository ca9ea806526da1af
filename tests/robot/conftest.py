import numpy as np
import pytest

from locate.fusion.views import Views
from locate.simulation.evidence import Corruption, Truth, corrupted_views, orbit, random_truth


@pytest.fixture(scope="session")
def truth() -> Truth:
    return random_truth(np.random.default_rng(5))


@pytest.fixture(scope="session")
def views(truth: Truth) -> Views:
    rng = np.random.default_rng(5)
    return corrupted_views(truth, orbit(12, 60), rng, Corruption(missed_views=0))
