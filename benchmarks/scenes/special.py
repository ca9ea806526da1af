"""The example scenes that are hard on purpose, end to end: two and five plumes, a hidden base.

    python -m benchmarks.scenes special --work work/special

Rendered where they do not stand yet, run with poses from structure from motion, and evaluated.
"""

import argparse
from pathlib import Path

from benchmarks.scenes.orbit import row, run
from locate.simulation import Scene, simulate

SCENES = Path(__file__).parents[2] / "examples" / "scenes"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--scenes", nargs="+", default=["two_plumes", "hidden_base", "five_plumes"])
    parser.add_argument("--resume", action="store_true", help="Keep the stages that stand.")
    parser.add_argument("--work", type=Path, default=Path("work/special"))


def main(options: argparse.Namespace) -> None:
    for name in options.scenes:
        folder = options.work / name
        if not (folder / "truth.json").exists():
            simulate(Scene.load(SCENES / f"{name}.yaml"), folder)
        outcome = run(folder / "video.mkv", resume=options.resume)
        print(row(name, outcome), flush=True)
        for note in () if outcome.plume_map is None else outcome.plume_map.notes:
            print(f"  {note}")
