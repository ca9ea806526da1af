"""`locate train`: shipped trainings by name, and clips that are not there yet."""

import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from detect.kinds import DYBS
from detect.learning.clips import clip_path
from detect.learning.config import PoolConfig, TrainConfig
from detect.network import Network
from detect.registered.features import FEATURES, Feature
from detect.synthesis.split import split_of_photo
from geometry.errors import BadInputError
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


class _Here:
    """Workers in this process."""

    def __init__(self, processes: int, mp_context: object) -> None:
        self.map = map

    def __enter__(self) -> "_Here":
        return self

    def __exit__(self, *_: object) -> None:
        pass
