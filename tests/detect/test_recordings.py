import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from detect.bos_checks import RecordingFault
from detect.pair_writer import crop_corners
from detect.recordings import PairSettings, RecordedPairs, record_pairs
from detect.synthesis import Recipe, render_dataset, shards_in
from detect.synthesis.split import split_of_name
from geometry.arrays import GreyImage
from geometry.errors import BadInputError
from tests.detect.scenes import Texture, photographed, ring_displacement

SHAPE = (96, 144)
STILL = 6
SETTINGS = PairSettings(flow="lucas-kanade", size_px=96, split="train")
TEXTURE = Texture(4, 1.2)
LENS = ring_displacement(SHAPE, 0.5, 12.0)


def photo(k: int, w: np.ndarray, gain: float = 1.0) -> GreyImage:
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    shake = np.random.default_rng(k).uniform(-0.1, 0.1, 2)
    u, v = np.moveaxis(w + shake, -1, 0)
    return photographed(gain * TEXTURE(x + u, y + v), seed=k)


def film(plumes: int = 4, *, faulty: int = 0) -> Iterator[GreyImage]:
    """Still air first, then as many frames with a plume, the last of them in other light."""
    for k in range(STILL):
        yield photo(k, 0 * LENS)
    for k in range(plumes):
        yield photo(STILL + k, LENS, gain=0.96 if k >= plumes - faulty else 1.0)


def record(folder: Path, name: str = "first", **changes: object) -> RecordedPairs:
    return record_pairs(name, film(**changes), STILL, folder, SETTINGS)


def test_the_dataset_reads_like_any_other_and_its_flow_is_right(tmp_path: Path) -> None:
    pairs = record(tmp_path)
    (shard,) = shards_in(tmp_path / "train")
    assert pairs.fault is None
    assert len(shard) == pairs.crops == 4 * 2
    for k in range(len(shard)):
        sample = shard.sample_at(k)
        truth = LENS[:, :96] if k % 2 == 0 else LENS[:, 48:]
        assert sample.family == "recorded"
        assert np.linalg.norm(sample.displacement - truth, axis=-1).mean() < 0.05
        assert (sample.mask == (np.linalg.norm(sample.displacement, axis=-1) > 0.05)).mean() > 0.99
    images = list(film())
    assert np.array_equal(shard.images[0], images[STILL][:, :96])
    assert np.array_equal(shard.images[3], images[STILL + 1][:, 48:])


def test_the_report_says_what_was_measured(tmp_path: Path) -> None:
    record(tmp_path)
    report = json.loads((tmp_path / "recordings/first.json").read_text())
    assert report["schema"] == "locate.recording/1"
    assert report["fault"] is None
    assert [frame["index"] for frame in report["frames"]] == list(range(STILL, STILL + 4))
    for frame in report["frames"]:
        shake = np.random.default_rng(frame["index"]).uniform(-0.1, 0.1, 2)
        assert np.abs(frame["shift_px"] - shake).max() < 0.06
        assert 0.35 < frame["peak_px"] < 0.7


def test_the_name_decides_the_split_and_only_the_name(tmp_path: Path) -> None:
    settings = PairSettings(flow="lucas-kanade", size_px=96)
    for name in ("a", "b", "c", "d"):
        pairs = record_pairs(name, film(1), STILL, tmp_path, settings)
        assert pairs.split == split_of_name(name)
        held = [path.parent.name for path in tmp_path.glob(f"*/shard_{name}_00000.npz")]
        assert held == [pairs.split]
    assert len({split_of_name(name) for name in ("a", "b", "c", "d")}) > 1


def test_a_name_recorded_again_replaces_what_was_there(tmp_path: Path) -> None:
    record(tmp_path, "first_00001", plumes=1)
    record(tmp_path, "first", plumes=4)
    record(tmp_path, "first", plumes=2)
    counts = [len(shard) for shard in shards_in(tmp_path / "train")]
    assert counts == [2 * 2, 1 * 2]


def test_one_bad_frame_in_many_is_left_out(tmp_path: Path) -> None:
    pairs = record(tmp_path, plumes=12, faulty=1)
    assert pairs.fault is None
    assert [frame.index for frame in pairs.kept] == list(range(STILL, STILL + 11))
    assert pairs.crops == 11 * 2


def test_a_bad_recording_is_refused_and_its_old_pairs_go(tmp_path: Path) -> None:
    record(tmp_path, plumes=2)
    pairs = record(tmp_path, plumes=4, faulty=3)
    assert pairs.fault is RecordingFault.LIGHT
    assert not pairs.kept
    assert not list(tmp_path.glob("*/shard_*"))
    report = json.loads((tmp_path / "recordings/first.json").read_text())
    assert "illumination" in report["fault"]
    assert [frame["fault"] for frame in report["frames"]] == [None, "light", "light", "light"]
    assert json.loads((tmp_path / "train/dataset.json").read_text())["recordings"] == []


def test_a_hopeless_recording_is_not_measured_to_its_end(tmp_path: Path) -> None:
    pairs = record(tmp_path, plumes=40, faulty=40)
    assert pairs.fault is RecordingFault.LIGHT
    assert len(pairs.frames) == 10


def test_every_second_frame_against_a_file(tmp_path: Path) -> None:
    settings = PairSettings(flow="lucas-kanade", size_px=64, every=2, split="test")
    pairs = record_pairs("a", film(3), photo(99, 0 * LENS), tmp_path, settings)
    assert [frame.index for frame in pairs.kept] == [0, 2, 4, 6, 8]
    assert pairs.kept[0].peak_px < 0.2 < pairs.kept[-1].peak_px


def test_nothing_is_left_behind(tmp_path: Path) -> None:
    record(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["recordings", "train"]


@pytest.mark.parametrize(
    ("plumes", "reference", "message"),
    [
        (0, STILL, "no frames are left"),
        (0, STILL + 1, "fewer than its reference"),
        (1, photo(0, 0 * LENS)[:, :96], "of one size"),
    ],
)
def test_what_cannot_be_used_is_named(
    tmp_path: Path, plumes: int, reference: GreyImage | int, message: str
) -> None:
    with pytest.raises(BadInputError, match=message):
        record_pairs("a", film(plumes), reference, tmp_path, SETTINGS)


def test_crops_of_one_size_only(tmp_path: Path) -> None:
    record(tmp_path, plumes=1)
    with pytest.raises(BadInputError, match="holds crops of 96 px"):
        record_pairs("b", film(1), STILL, tmp_path, PairSettings(size_px=64, split="train"))


def test_rendered_samples_are_not_mixed_with_recorded_ones(tmp_path: Path) -> None:
    render_dataset(Recipe(families={"sinusoid": 1}, size_px=96), 1, tmp_path / "train")
    with pytest.raises(BadInputError, match="holds rendered samples"):
        record(tmp_path)


def test_frames_smaller_than_a_crop_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="take --size 96 or less"):
        record_pairs("a", film(1), STILL, tmp_path, PairSettings(size_px=128))


@pytest.mark.parametrize(("shape", "count"), [((96, 96), 1), ((96, 97), 2), ((200, 300), 12)])
def test_crops_cover_the_frame(shape: tuple[int, int], count: int) -> None:
    covered = np.zeros(shape, bool)
    places = crop_corners(shape, 96)
    for x, y in places:
        part = covered[y : y + 96, x : x + 96]
        assert part.shape == (96, 96)
        part[:] = True
    assert covered.all()
    assert len(places) == count
