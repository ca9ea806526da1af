import numpy as np
import pytest

from geometry.normal_errors import quick_quantile


@pytest.mark.parametrize("shape", [(1,), (2,), (7,), (40, 53)])
@pytest.mark.parametrize("share", [0.0, 0.5, 0.9, 1.0])
def test_a_quick_quantile_is_that_of_numpy(shape: tuple[int, ...], share: float) -> None:
    values = np.random.default_rng(0).normal(size=shape).astype(np.float32)
    before = values.copy()
    assert quick_quantile(values, share) == pytest.approx(np.quantile(values, share), rel=1e-5)
    assert (values == before).all()
