"""The example scenes that are hard on purpose, end to end: two plumes, and a hidden base.

    python benchmarks/special_scenes.py --work work/special

Rendered where they do not stand yet, run with poses from structure from motion, and evaluated.
"""

import argparse
from pathlib import Path

import cv2

from benchmarks.scenes.orbit import row, run
from locate.simulation import Scene, simulate

SCENES = Path(__file__).parents[2] / "examples" / "scenes"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", nargs="+", default=["two_plumes", "hidden_base"])
    parser.add_argument("--resume", action="store_true", help="Keep the stages that stand.")
    parser.add_argument("--work", type=Path, default=Path("work/special"))
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    for name in arguments.scenes:
        folder = arguments.work / name
        if not (folder / "truth.json").exists():
            simulate(Scene.load(SCENES / f"{name}.yaml"), folder)
        outcome = run(folder, resume=arguments.resume)
        print(row(name, outcome), flush=True)
        for note in () if outcome.plume_map is None else outcome.plume_map.notes:
            print(f"  {note}")


if __name__ == "__main__":
    main()
