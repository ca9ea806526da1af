from pathlib import Path

import yaml

from detect.dybs.pattern_measurement import CHANNELS
from detect.learning.config import TrainConfig
from detect.synthesis import Recipe, render_dataset, shards_in
from locate.commands.train import measure_missing


def test_samples_are_measured_before_a_training_on_measurements(tmp_path: Path) -> None:
    render_dataset(Recipe(families={"sinusoid": 1}, size_px=64), 4, tmp_path / "samples")
    path = tmp_path / "judge.yaml"
    pools = {"measured": {"folder": "measured", "measured": "samples", "samples": 4}}
    stage = {"name": "one", "pools": {"measured": 1}, "steps": 1, "learning_rate": [1e-3, 1e-3]}
    content = {"name": "j", "pools": pools, "validation": "measured", "stages": [stage]}
    path.write_text(yaml.safe_dump(content))
    told: list[tuple[str, float]] = []
    measure_missing(TrainConfig.load(path), report=lambda *what: told.append(what))
    (shard,) = shards_in(tmp_path / "measured")
    assert shard.images.shape == (4, 32, 32, CHANNELS)
    assert told == [("measured: measured", 1.0)]
