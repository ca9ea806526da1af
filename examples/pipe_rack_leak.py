"""A leak on a pipe rack, from the scene file to the map, and the map compared with the truth.

    python examples/pipe_rack_leak.py            # 60 frames: a few minutes on two cores
    python examples/pipe_rack_leak.py --frames 24

The four steps below are what `locate simulate`, `locate run` and `locate evaluate` do.
"""

import argparse
from pathlib import Path

from rich.console import Console

import locate
from locate.evaluation import Evaluation
from locate.evaluation.table import evaluation_table
from locate.export.table import map_table
from locate.journal.progress import progress_bars
from locate.simulation import Scene, simulate

SCENE = Path(__file__).parent / "scenes" / "pipe_rack_leak.yaml"


def main(output: Path, frames: int) -> Evaluation:
    console = Console()

    # 1. Film it: a plant of textured solids, hot gas that rises and swirls, a camera on an arc of
    #    60 degrees. Fewer frames keep the arc and take wider steps.
    scene = Scene.load(SCENE)
    scene = scene.model_copy(update={"video": scene.video.model_copy(update={"frames": frames})})
    recording = output / "recording"
    with progress_bars(console) as report:
        if not (recording / "truth.json").exists():
            simulate(scene, recording, progress=lambda done, total: report("film", done / total))

        # 2. Run it, knowing nothing but the video: structure from motion finds the cameras, the
        #    registered detector what bends the light, fusion where in space that is.
        plume_map = locate.run(recording / "video.mkv", output / "run", report=report)

    # 3. Read the answer. Without GPS or a known length the scale is free: "scene units".
    console.print(map_table(plume_map))

    # 4. Compare it with the truth. The evaluation fits the free scale by the cameras' positions;
    #    NEES is the squared error in units of the stated covariance, 3 on average if that is right.
    evaluation = locate.evaluate(output / "run", recording)
    console.print(evaluation_table(evaluation))
    console.print(f"Look at {output / 'run' / 'report.html'}", soft_wrap=True)
    return evaluation


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=Path("out/pipe_rack_leak"))
    parser.add_argument("--frames", type=int, default=60)
    arguments = parser.parse_args()
    main(arguments.output, arguments.frames)
