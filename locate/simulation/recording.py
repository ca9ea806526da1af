"""`locate simulate SCENE.yaml -o DIR`."""

from collections.abc import Callable, Iterator
from pathlib import Path

from geometry.arrays import GreyImage
from locate.simulation.camera_paths import simulate_trajectory
from locate.simulation.capture import CaptureSetup, build_surfaces
from locate.simulation.plume_field import PlumeField
from locate.simulation.render import Renderer
from locate.simulation.scene import Scene
from locate.simulation.writer import create_recording, make_folder, write_summary, write_truth

Progress = Callable[[int, int], None]


def ignore_progress(_done: int, _total: int) -> None:
    """Reports nothing."""


def simulate(scene: Scene, output: Path, *, progress: Progress = ignore_progress) -> None:
    """Renders a recording and the truth about it.

    Writes video.mkv (or .mp4), truth.json, truth/{index:06d}.npz and scene.yaml into `output`.

    Args:
        scene: What to record.
        output: Folder to write, made where it does not stand.
        progress: Called with the number of frames done and their total.

    Raises:
        BadInputError: The folder cannot be written.
    """
    write_recording(CaptureSetup(scene=scene), output, progress=progress)


def write_recording(
    capture: CaptureSetup, output: Path, *, progress: Progress = ignore_progress
) -> None:
    """As `simulate`, of a capture; frames that its coding spoils are kept as they then are."""
    scene = capture.scene
    make_folder(output)
    scene.save(output / "scene.yaml")
    trajectory = simulate_trajectory(scene)
    fields = [PlumeField(scene, number) for number in range(len(scene.plumes))]
    renderer = Renderer(scene, build_surfaces(capture), fields, trajectory, capture.shutter)

    def frames() -> Iterator[GreyImage]:
        for i in range(len(trajectory)):
            image, truth = renderer.render_frame(i)
            write_truth(output, i, truth)
            progress(i + 1, len(trajectory))
            yield image

    coding = capture.coding
    stored = frames() if coding is None else coding(list(frames()), scene.video.fps).images
    with create_recording(output, scene.video, trajectory.camera) as video:
        for image in stored:
            video.write(image)
    write_summary(output, trajectory, fields, renderer.amplitudes_px)
