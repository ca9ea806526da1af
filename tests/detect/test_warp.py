import numpy as np
import pytest

from detect.warp import pixel_grid, sample


@pytest.mark.parametrize("shift_px", [0.1, 0.25, 0.3, 0.5])
@pytest.mark.parametrize("wavenumber", [0.3, 0.8, 1.2])
def test_sampling_moves_by_just_what_was_asked(shift_px: float, wavenumber: float) -> None:
    positions = pixel_grid((60, 120))
    wave = np.sin(wavenumber * positions[..., 0]).astype(np.float32)
    moved = sample(wave, positions + np.array([shift_px, 0], np.float32))[:, 10:-10]
    carrier = np.exp(-1j * wavenumber * positions[:, 10:-10, 0])
    phase = np.angle((moved * carrier).mean() / (wave[:, 10:-10] * carrier).mean())
    assert phase / wavenumber == pytest.approx(shift_px, abs=0.01)


def test_whole_pixels_come_back_exactly() -> None:
    image = np.random.default_rng(0).integers(0, 256, (20, 30), dtype=np.uint8)
    np.testing.assert_array_equal(sample(image, pixel_grid(image.shape)), image)
