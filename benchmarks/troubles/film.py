"""Films the scene of the bundled sample without its plume: the recording in which all is false.

    python -m benchmarks.troubles film [OUTPUT]

Writes the video and its truth into OUTPUT, by default work/no_plume; prints nothing.
"""

import argparse
from pathlib import Path

from locate.recording.sample import SAMPLE
from locate.simulation.recording import simulate
from locate.simulation.scene import Scene

OUTPUT = Path("work/no_plume")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("output", type=Path, nargs="?", default=OUTPUT)


def main(options: argparse.Namespace) -> None:
    simulate(scene_without_plume(), options.output)


def scene_without_plume() -> Scene:
    """The sample's, the same but for its plume."""
    return Scene.load(SAMPLE / "scene.yaml").model_copy(update={"plumes": ()})
