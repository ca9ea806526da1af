import numpy as np
import pytest

from locate.fusion.views import Views
from locate.simulation.evidence import (
    ColumnTruth,
    EvidenceFaults,
    make_faulty_views,
    orbit_trajectory,
    random_column,
)


@pytest.fixture(scope="session")
def truth() -> ColumnTruth:
    return random_column(np.random.default_rng(5))


@pytest.fixture(scope="session")
def views(truth: ColumnTruth) -> Views:
    rng = np.random.default_rng(5)
    return make_faulty_views(truth, orbit_trajectory(12, 60), rng, EvidenceFaults(missed_views=0))
