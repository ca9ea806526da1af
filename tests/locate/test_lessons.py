from pathlib import Path

import numpy as np
import pytest

from detect.registered.features import FEATURES
from detect.registered.lessons import Lesson
from geometry.errors import BadInputError
from locate.simulation import lessons
from locate.simulation.lessons import lesson_scene, make_lesson

STILL_AIR_SEED = 100_001


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in {
        "FRAMES": 11,
        "KEY_FRAMES": 2,
        "SIDE_PX": (128, 96),
        "FOCAL_PX": (110.0, 110.0),
    }.items():
        monkeypatch.setattr(lessons, name, value)


@pytest.mark.usefixtures("small")
def test_a_lesson_of_still_air_is_the_same_every_time(tmp_path: Path) -> None:
    lesson = make_lesson(STILL_AIR_SEED)
    assert lesson.inputs.shape == (2, len(FEATURES), 96, 128)
    assert np.isfinite(lesson.inputs).all()
    assert not lesson.displacements.any()
    assert lesson.amplitude_px == 0
    lesson.save(tmp_path / "a.npz")
    again, anew = Lesson.load(tmp_path / "a.npz"), make_lesson(STILL_AIR_SEED)
    for other in (again, anew):
        np.testing.assert_array_equal(other.inputs, lesson.inputs)
        np.testing.assert_array_equal(other.surface, lesson.surface)


def test_lessons_are_of_many_kinds() -> None:
    scenes = [lesson_scene(seed) for seed in range(60)]
    assert {scene.path.kind for scene in scenes} == {"orbit", "handheld", "lawn_mower"}
    free = sum(not scene.plumes for scene in scenes)
    assert 10 < free < 35
    amplitudes = [p.amplitude_px for scene in scenes for p in scene.plumes if p.amplitude_px]
    assert min(amplitudes) < 0.15
    assert max(amplitudes) > 1.0


def test_a_broken_lesson_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.npz").write_bytes(b"PK\x03\x04 and no more")
    with pytest.raises(BadInputError, match="a lesson"):
        Lesson.load(tmp_path / "a.npz")
