"""The benchmarks of the paper's experiments measure what they say."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.paper import plate, rows
from detect.detection import Detection
from detect.synthesis.camera import MARGIN_PX

SHAPE = (40, 60)


@pytest.fixture
def seen() -> rows.AnsweredFrame:
    """A plume on the left half, 0.3 px to the right, and a method that knows it."""
    truth = np.zeros((*SHAPE, 2), np.float32)
    truth[:, :30, 0] = 0.3
    llr = np.where(truth[..., 0] > 0, np.float32(3), np.float32(-1))
    return rows.AnsweredFrame(
        image=np.zeros(SHAPE, np.uint8),
        truth=truth,
        answer=Detection(displacement=truth.copy(), sigma_px=np.ones(SHAPE, np.float32), llr=llr),
        counts=np.ones(SHAPE, dtype=bool),
        beside=np.zeros(SHAPE, dtype=bool),
    )


def cells(*frames: rows.AnsweredFrame) -> list[str]:
    return [cell.strip() for cell in rows.score_row(frames).split("|")]


def test_a_perfect_answer(seen: rows.AnsweredFrame) -> None:
    assert cells(seen, seen) == [
        "2", "0.0000 / 0.1500", "0.000 / 0.300", "1.00", "1.000", "1.00", "1.00", "1.00", "",
    ]  # fmt: skip


def test_silence_has_an_error_of_the_plumes_own_size(seen: rows.AnsweredFrame) -> None:
    nothing = Detection(
        displacement=np.zeros_like(seen.truth),
        sigma_px=np.ones(SHAPE, np.float32),
        llr=np.zeros(SHAPE, np.float32),
    )
    assert cells(replace(seen, answer=nothing)) == [
        "1", "0.1500 / 0.1500", "0.300 / 0.300", "0.00", "0.500", "none", "0.00", "0.00", "",
    ]  # fmt: skip


def test_objects_do_not_count_and_their_surroundings_are_told(seen: rows.AnsweredFrame) -> None:
    answer = replace(seen.answer, displacement=seen.truth.copy())
    answer.displacement[:10] += 7
    answer.displacement[10:12, :, 1] = 2
    covered, beside = np.zeros(SHAPE, dtype=bool), np.zeros(SHAPE, dtype=bool)
    covered[:10], beside[:12] = True, True
    told = cells(replace(seen, answer=answer, counts=~covered, beside=beside))
    assert told[-1] == "2.000, 2.00"


def test_the_plate_hides_the_lattice_where_it_stands_and_nothing_else() -> None:
    moved = plate.SETUPS[3]
    y, x = np.mgrid[: plate.SIZE_PX, : plate.SIZE_PX].astype(float)
    now, then, absent = (
        plate.objects(moved, shift)(x, y) for shift in (0.0, moved.reference_shift_px, None)
    )
    assert not (absent & ~now).any()
    solid = now & ~absent
    assert 3 * 16 * plate.CELL_PX**2 <= solid.sum() < 0.02 * solid.size
    right, down = round(plate.MOVED_PX), round(plate.MOVED_PX)
    back = np.roll(then & ~absent, (-down, -right), axis=(0, 1))
    assert (back != solid)[:, : -2 * right].mean() < 1e-3


def test_a_potential_stands_on_the_heat_source() -> None:
    x, z = np.meshgrid(np.arange(48.0), np.arange(96.0), indexing="ij")
    excess = np.exp(-((x - 23.5) ** 2) / 18 - ((z - 40) ** 2) / 50).astype(np.float32)
    w = plate.in_frame(excess)[MARGIN_PX:-MARGIN_PX, MARGIN_PX:-MARGIN_PX]
    assert w.shape == (plate.SIZE_PX, plate.SIZE_PX, 2)
    row = round(plate.SIZE_PX - plate.BASE_PX - 40 * plate.CELL_PX)
    middle = plate.SIZE_PX // 2
    assert np.linalg.norm(w[row, middle]) < 0.1 * np.abs(w).max()
    assert w[row, middle - 20, 0] > 0 > w[row, middle + 20, 0]
    assert w[row - 20, middle, 1] > 0 > w[row + 20, middle, 1]


def test_an_answer_is_drawn_at_the_scale_of_its_truth(seen: rows.AnsweredFrame) -> None:
    side = 40
    fields = seen.truth, seen.truth / np.float32(3), 3 * seen.truth
    shown = rows.draw_strip(seen.image, *fields, side=side)
    width = shown.shape[1] // 4
    saturations = [255 - shown[side - 5, k * width + 10].min() for k in (1, 2, 3)]
    assert saturations == [255, pytest.approx(85, abs=2), 255]
