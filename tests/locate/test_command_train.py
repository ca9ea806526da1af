"""`locate train`: shipped trainings by name, and clips that are not there yet."""

import errno
import os
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml

from detect.kinds import DYBS
from detect.learning import render
from detect.learning.clips import TrainingClip, clip_path
from detect.learning.config import PoolConfig, TrainConfig
from detect.network import Network
from detect.registered.features import FEATURES, Feature
from detect.synthesis.dataset import render_dataset
from detect.synthesis.recipe import Recipe
from detect.synthesis.split import split_of_photo
from geometry.errors import BadInputError, UnwritableError
from locate import cli
from locate.commands import train
from locate.commands.train import config_path, render_missing_clips
from locate.simulation import make_clips


@pytest.mark.parametrize("name", ["registered", "lite-fast", "lite", "paper"])
def test_shipped_trainings_have_names(name: str) -> None:
    path = config_path(Path(name))
    assert path.stem == name.replace("-", "_")
    assert TrainConfig.load(path, Path("data")).steps > 0


def test_a_file_is_a_file_and_a_typo_is_named(tmp_path: Path) -> None:
    mine = tmp_path / "mine.yaml"
    assert config_path(mine) == mine
    with pytest.raises(BadInputError, match="lite, lite-fast, paper, registered"):
        config_path(Path("regstered"))


def test_the_shipped_weights_are_those_of_the_shipped_training() -> None:
    told = Network(DYBS.find_weights()).read_metadata("trained_on")
    config = TrainConfig.load(config_path(Path("lite-fast")))
    assert config.weights_digest(told["steps"]) == told["config"]


def test_the_registered_training_fits_its_features() -> None:
    config = TrainConfig.load(config_path(Path("registered")), Path("data"))
    assert config.network.channels == len(FEATURES)
    assert not config.network.normalise
    vectors: list[tuple[Feature, Feature]] = [
        ("displacement_x", "displacement_y"),
        ("first_displacement_x", "first_displacement_y"),
        ("significance_x", "significance_y"),
    ]
    places = tuple((FEATURES.index(x), FEATURES.index(y)) for x, y in vectors)
    assert config.augmentation.vectors == places
    held = set(config.pools[config.validation].all_seeds())
    for stage in config.stages:
        for name in stage.pools:
            assert held.isdisjoint(config.pools[name].all_seeds())


def test_only_missing_clips_are_rendered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "photos").mkdir()
    for number in range(30):
        (tmp_path / "photos" / f"{number}.png").touch()
    config = TrainConfig.load(config_path(Path("registered")), tmp_path)
    plants = PoolConfig(folder=tmp_path / "plants", seeds=((3, 6),))
    photos = PoolConfig(
        folder=tmp_path / "more", seeds=((8, 9),), photos=tmp_path / "photos", leaks="anywhere"
    )
    config = config.model_copy(update={"pools": {"plants": plants, "photos": photos}})
    plants.folder.mkdir()
    clip_path(plants.folder, 4).touch()
    made = []

    def render(pool: PoolConfig, photos: tuple[Path, ...], seed: int) -> None:
        splits = {split_of_photo(photo) for photo in photos}
        made.append((pool.folder.name, splits, pool.leaks, seed))

    monkeypatch.setattr(train, "ProcessPoolExecutor", _Here)
    monkeypatch.setattr(train, "_render_clip", render)
    told: list[tuple[str, float]] = []
    render_missing_clips(config, report=lambda what, share: told.append((what, share)))
    assert made == [
        ("plants", set(), "nozzle", 3),
        ("plants", set(), "nozzle", 5),
        ("more", {"train"}, "anywhere", 8),
    ]
    assert told == [("clips: plants", 0.5), ("clips: plants", 1), ("clips: photos", 1)]


def test_each_pool_is_rendered_its_own_way(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[object, ...]] = []

    def noted(kind: str) -> Callable[..., None]:
        return lambda *given, **named: asked.append((kind, *given, named))

    monkeypatch.setattr(make_clips, "write_photo_clips", noted("photos"))
    monkeypatch.setattr(make_clips, "write_photo_set_clips", noted("set"))
    folder, photos = tmp_path / "lessons", [tmp_path / "a.png"]
    rough = PoolConfig(folder=folder, photos=tmp_path, rough=True)
    coded = PoolConfig(folder=folder, photos=tmp_path, leaks="anywhere", coded=True)
    train._render_clip(rough, photos, 3)
    train._render_clip(coded, photos, 5)
    train._render_clip(PoolConfig(folder=folder, photo_set=tmp_path / "set"), (), 4)
    assert asked == [
        ("photos", photos, [3], folder, {"leaks": "nozzle", "rough": True, "coded": False}),
        ("photos", photos, [5], folder, {"leaks": "anywhere", "rough": False, "coded": True}),
        ("set", tmp_path / "set", [4], folder, {}),
    ]
    with pytest.raises(ValueError, match="made of photos"):
        PoolConfig(folder=folder, rough=True)
    with pytest.raises(ValueError, match="not of photo sets"):
        PoolConfig(folder=folder, photo_set=tmp_path / "set", coded=True)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("gone.onnx", "gone.onnx: no such network"),
        ("text.onnx", "text.onnx: not a readable"),
        ("gone.pt", "gone.pt: not a readable checkpoint"),
        ("text.pt", "text.pt: not a readable checkpoint"),
    ],
)
def test_a_broken_network_to_begin_with_is_told_before_anything_is_rendered(
    tmp_path: Path,
    name: str,
    said: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    for damaged in ("text.onnx", "text.pt"):
        (tmp_path / damaged).write_text("no network")
    stage = {"name": "one", "pools": {"plants": 1}, "steps": 1, "learning_rate": [1e-3, 1e-3]}
    pools = {"plants": {"folder": "plants", "seeds": [[0, 1]]}}
    content = {"name": "a", "pools": pools, "validation": "plants", "stages": [stage]}
    (tmp_path / "a.yaml").write_text(yaml.safe_dump(content | {"initial": name}))
    monkeypatch.setattr(
        sys, "argv", ["locate", "train", str(tmp_path / "a.yaml"), "-o", str(tmp_path / "out")]
    )
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 2
    assert said in " ".join(capsys.readouterr().err.splitlines())
    assert not (tmp_path / "plants").exists()


CLIPS = {"folder": "clips", "seeds": [[0, 2]]}
RECIPE = {"folder": "samples", "samples": 3, "recipe": "recipe.yaml"}


@pytest.mark.parametrize(
    ("pool", "said"),
    [
        ({**CLIPS, "photos": "photos"}, "photos: no photos for the train split"),
        ({**CLIPS, "photo_set": "set"}, "set: not a folder of posed photos"),
        (CLIPS, "network: channels is 1, clips have 13"),
        ({"folder": "cut"}, "lesson_000001.npz: not a training clip"),
        (RECIPE, "photos: no photos for the train split"),
        ({**RECIPE, "folder": "other"}, "other: holds samples of another recipe"),
        ({**RECIPE, "recipe": "gone.yaml"}, "gone.yaml"),
        ({**RECIPE, "folder": "broken"}, "shard_00000.npz: not a shard of samples"),
        ({"folder": "nowhere", "samples": 3}, "nowhere: 0 of 3 samples"),
        ({"folder": "measured", "measured": "nowhere"}, "nowhere: 0 of 1 samples"),
    ],
)
def test_what_is_missing_or_broken_is_told_before_anything_is_rendered(
    tmp_path: Path,
    pool: dict[str, object],
    said: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    for name in ("cut", "broken", "other"):
        (tmp_path / name).mkdir()
    clip = np.zeros((1, 13, 8, 8), np.float16)
    TrainingClip(
        inputs=clip, displacements=np.zeros((1, 8, 8, 2), np.float16), surface=clip[:, 0] == 0,
        amplitude_px=0.0,
    ).save(clip_path(tmp_path / "cut", 1))  # fmt: skip
    cut = clip_path(tmp_path / "cut", 1)
    cut.write_bytes(cut.read_bytes()[:-40])
    (tmp_path / "broken" / "shard_00000.npz").write_text("no shard")
    (tmp_path / "recipe.yaml").write_text("families: {photo: 1}\nphotos: photos\n")
    (tmp_path / "first.yaml").write_text("families: {sinusoid: 1}\nsize_px: 32\n")
    if pool["folder"] == "other":
        (tmp_path / "recipe.yaml").write_text("families: {lines: 1}\nsize_px: 32\n")
        render_dataset(Recipe.load(tmp_path / "first.yaml"), 1, tmp_path / "other")
    first = {"folder": "first", "samples": 1, "recipe": "first.yaml"}
    stage = {"name": "one", "pools": {"b": 1}, "steps": 1, "learning_rate": [1e-3, 1e-3]}
    pools = {"a": first, "b": pool}
    content = {"name": "a", "pools": pools, "validation": "a", "stages": [stage]}
    (tmp_path / "a.yaml").write_text(yaml.safe_dump(content))
    monkeypatch.setattr(
        sys, "argv", ["locate", "train", str(tmp_path / "a.yaml"), "-o", str(tmp_path / "out")]
    )
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 2
    assert said in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "first").exists()


def test_a_full_disk_is_one_line_with_what_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fill(*_: object, **__: object) -> None:
        full = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        raise UnwritableError.of(tmp_path / "a.npz", full)

    (tmp_path / "first.yaml").write_text("families: {sinusoid: 1}\nsize_px: 32\n")
    stage = {"name": "one", "pools": {"a": 1}, "steps": 1, "learning_rate": [1e-3, 1e-3]}
    pools = {"a": {"folder": "first", "samples": 1, "recipe": "first.yaml"}}
    content = {"name": "a", "pools": pools, "validation": "a", "stages": [stage]}
    (tmp_path / "a.yaml").write_text(yaml.safe_dump(content))
    monkeypatch.setattr(render, "render_missing", fill)
    monkeypatch.setattr(
        sys, "argv", ["locate", "train", str(tmp_path / "a.yaml"), "-o", str(tmp_path / "out")]
    )
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 2
    assert capsys.readouterr().err.splitlines() == [
        f"locate: {tmp_path / 'a.npz'}: cannot be written (No space left on device); what was "
        "finished before is kept, the same command goes on from there"
    ]


def test_a_place_of_data_that_is_none_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    nowhere = str(tmp_path / "nowhere")
    monkeypatch.setattr(
        sys, "argv", ["locate", "train", "lite", "-o", str(tmp_path / "out"), "--data", nowhere]
    )
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 2
    assert f"{nowhere}: no such folder" in " ".join(capsys.readouterr().err.split())
    assert list(tmp_path.iterdir()) == []


class _Here:
    """Workers in this process."""

    def __init__(self, processes: int, mp_context: object) -> None:
        self.map = map

    def __enter__(self) -> "_Here":
        return self

    def __exit__(self, *_: object) -> None:
        pass
