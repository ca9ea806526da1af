from pathlib import Path

import numpy as np
import pytest

from detect.learning.clips import TrainingClip
from detect.registered.features import FEATURES, SMALL_PX
from geometry.errors import BadInputError
from locate.recording.spacing import spread_key_rows
from locate.simulation import clips
from locate.simulation.clips import UNUSED_END_FRAMES, draw_clip_scene, make_clip
from locate.simulation.scene import CylinderObject

STILL_AIR_SEED = 100_001


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in {
        "CLIP_FRAMES": 11,
        "KEY_FRAMES": 2,
        "SIDE_PX": (128, 96),
        "FOCAL_PX": (110.0, 110.0),
    }.items():
        monkeypatch.setattr(clips, name, value)


@pytest.mark.usefixtures("small")
def test_a_clip_of_still_air_is_the_same_every_time(tmp_path: Path) -> None:
    clip = make_clip(STILL_AIR_SEED)
    assert clip.inputs.shape == (2, len(FEATURES), 96, 128)
    assert np.isfinite(clip.inputs).all()
    assert not clip.displacements.any()
    assert clip.amplitude_px == 0
    clip.save(tmp_path / "a.npz")
    again, anew = TrainingClip.load(tmp_path / "a.npz"), make_clip(STILL_AIR_SEED)
    for other in (again, anew):
        np.testing.assert_array_equal(other.inputs, clip.inputs)
        np.testing.assert_array_equal(other.surface, clip.surface)


@pytest.mark.usefixtures("small")
def test_a_coded_clip_is_measured_less_sharply() -> None:
    def sigma_px(*, coded: bool) -> float:
        channel = make_clip(STILL_AIR_SEED, coded=coded).inputs[:, FEATURES.index("log_sigma")]
        return float(np.median(SMALL_PX * np.exp(channel.astype(float))))

    assert sigma_px(coded=True) > sigma_px(coded=False)


def test_key_frames_are_not_b_frames_where_others_are_near() -> None:
    plain = spread_key_rows(24, 4, ends=UNUSED_END_FRAMES)
    b_frames = [row for row in range(24) if row % 3]
    chosen = spread_key_rows(24, 4, ends=UNUSED_END_FRAMES, b_frames=b_frames)
    assert plain.tolist() == [4, 9, 14, 19]
    assert chosen.tolist() == [6, 9, 15, 18]


def test_clips_are_of_many_kinds() -> None:
    scenes = [draw_clip_scene(seed) for seed in range(60)]
    assert {scene.path.kind for scene in scenes} == {"orbit", "handheld", "lawn_mower"}
    free = sum(not scene.plumes for scene in scenes)
    assert 10 < free < 35
    amplitudes = [p.amplitude_px for scene in scenes for p in scene.plumes if p.amplitude_px]
    assert min(amplitudes) < 0.15
    assert max(amplitudes) > 1.0


def test_plumes_leave_from_anywhere() -> None:
    scenes = [draw_clip_scene(seed, leaks="anywhere") for seed in range(80)]
    assert 20 < sum(not scene.plumes for scene in scenes) < 45
    exits, apart_m = [], []
    for scene in scenes:
        sources = [np.array(plume.source) for plume in scene.plumes]
        ends = np.array([each.end for each in scene.objects if isinstance(each, CylinderObject)])
        exits += [float(np.linalg.norm(ends - at, axis=1).min()) for at in sources]
        apart_m += [np.linalg.norm(np.subtract(*sources)[:2]) for _ in sources[1:]]
    assert 0.1 < np.mean(np.array(exits) < 0.05) < 0.4
    assert len(apart_m) > 5
    assert max(apart_m) <= 2.0


def test_a_broken_clip_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.npz").write_bytes(b"PK\x03\x04 and no more")
    with pytest.raises(BadInputError, match="a training clip"):
        TrainingClip.load(tmp_path / "a.npz")
