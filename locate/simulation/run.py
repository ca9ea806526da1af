"""`locate simulate SCENE.yaml -o DIR`."""

from collections.abc import Callable
from pathlib import Path

from locate.simulation.paths import fly
from locate.simulation.plume import PlumeField
from locate.simulation.render import Renderer
from locate.simulation.scene import Scene
from locate.simulation.world import World
from locate.simulation.writer import make_folder, open_recording, write_summary, write_truth

Progress = Callable[[int, int], None]


def silent(_done: int, _total: int) -> None:
    """Reports nothing."""


def simulate(scene: Scene, output: Path, *, progress: Progress = silent) -> None:
    """Renders a recording and the truth about it.

    Writes video.mkv (or .mp4), truth.json, truth/{index:06d}.npz and scene.yaml into `output`.

    Args:
        scene: What to record.
        output: Folder to write, made where it does not stand.
        progress: Called with the number of frames done and their total.

    Raises:
        BadInputError: The folder cannot be written.
    """
    make_folder(output)
    scene.save(output / "scene.yaml")
    trajectory = fly(scene)
    fields = [PlumeField(scene, number) for number in range(len(scene.plumes))]
    renderer = Renderer(scene, World(scene), fields, trajectory)
    with open_recording(output, scene.video, trajectory.camera) as video:
        for i in range(len(trajectory)):
            image, truth = renderer.render(i)
            video.write(image)
            write_truth(output, i, truth)
            progress(i + 1, len(trajectory))
    write_summary(output, trajectory, fields, renderer.amplitudes_px)
