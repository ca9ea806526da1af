"""What a camera at rest takes for a plume: leaks, and bushes in the wind.

    python -m benchmarks.scenes still --photos PHOTOS
    python -m benchmarks.scenes still --photos PHOTOS --kinds wind --seeds 8100 8101
    python -m benchmarks.scenes still --photos PHOTOS --kinds leak --seeds 8200 --plot still.jpg
    python -m benchmarks.scenes still --photos PHOTOS --kinds leak --amplitude 2 --bits 0.15 0.2

Each recording is a random plant filmed from one place: 60 frames of 480x360 in 4 s, with a leak
of 0.3 to 1 px, without one but with swaying bushes, or with neither. `--bits` also runs each as an
H.264 video of so many bits a pixel. `--plot` draws the frame with
the bearings, what lasts from frame to frame (white is ten sigmas), and the true displacement.
"""

import argparse
import shutil
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.scenes.orbit import render
from detect.fluctuation import Fluctuation
from detect.synthesis.raster import find_photos
from geometry.arrays import GreyImage
from geometry.image_files import write_image
from locate.evaluation import evaluate_map
from locate.evaluation.truth import SceneTruth
from locate.map.plume import PlumeMap
from locate.pipeline.config import RunConfig
from locate.pipeline.run import Run
from locate.recording.opening import open_recording
from locate.recording.writer import H264
from locate.simulation import Scene, random_scene
from locate.simulation.compression import write_coded

KINDS = ("leak", "wind", "clean")
SEEDS = range(8100, 8108)
WIDTH_PX = 320


def still_scene(seed: int, *, plume: bool, amplitude_px: float | None) -> Scene:
    rng = np.random.default_rng([seed, 77])
    usual_px, noise = rng.uniform(0.3, 1.0), rng.uniform(0.5, 2.0)
    scene = random_scene(seed, plume=plume, amplitude_px=amplitude_px or usual_px, noise=noise)
    path = scene.path.model_copy(update={"kind": "hover", "jitter_m": 0.0, "jitter_deg": 0.0})
    camera = {"width": 480, "height": 360, "focal_px": 0.75 * scene.camera.focal_px}
    return scene.model_copy(
        update={
            "path": path,
            "camera": scene.camera.model_copy(update=camera),
            "image": scene.image.model_copy(update={"samples": 1}),
        }
    )


def shrink(image: GreyImage) -> GreyImage:
    size = (WIDTH_PX, image.shape[0] * WIDTH_PX // image.shape[1])
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA))


def code(folder: Path, bits_per_pixel: float) -> Path:
    """The folder of the recording stored as H.264, made where it is missing."""
    coded = folder.with_name(f"{folder.name}_{bits_per_pixel:g}")
    if (coded / "truth.json").exists():
        return coded
    images = [frame.image for frame in open_recording(folder / "video.mkv").frames()]
    fps = Scene.load(folder / "scene.yaml").video.fps
    shutil.copytree(folder / "truth", coded / "truth", dirs_exist_ok=True)
    write_coded(coded / "video.mkv", images, fps, codec=H264, bits_per_pixel=bits_per_pixel)
    shutil.copy(folder / "truth.json", coded)
    return coded


def evaluate_recording(folder: Path) -> str:
    plume_map = Run(RunConfig(recording=folder / "video.mkv"), folder / "run").run()
    verdict = evaluate_map(plume_map, None, folder)
    nats = ", ".join(f"{bearing.evidence_nats:.0f}" for bearing in plume_map.bearings)
    true = "; ".join(f"{b.error_deg:.1f} deg, {b.sigmas:.1f} sigma" for b in verdict.bearings)
    left_out = [note for note in plume_map.notes if "to and fro" in note]
    limit_px = plume_map.detection_limit_px
    return (
        f"{folder.name} | limit {'-' if limit_px is None else f'{limit_px:.2f} px'} | "
        f"bearings of {nats or '-'} nats | true {true or '-'} | "
        f"false {len(verdict.false_plumes)} | {left_out[0].split(' as ')[0] if left_out else '-'}"
    )


def picture(folder: Path) -> NDArray[np.uint8]:
    """(H, 3 W, 3) a frame with its bearings, what lasts, and the truth."""
    images = [shrink(f.image) for f in open_recording(folder / "video.mkv").frames()]
    lasting = Fluctuation.measure(images, np.random.default_rng(0)).sigmas
    truth = SceneTruth.load(folder)
    truths = [truth.frame(i) for i in range(0, len(images), 4)]
    squares = [(true.displacement**2).sum(axis=-1) for true in truths if true is not None]
    true_px = cv2.resize(np.sqrt(np.mean(squares, axis=0)), lasting.shape[::-1])
    shown = [images[0], 25.5 * lasting, 255 * true_px / max(float(true_px.max()), 1e-9)]
    panels = [cv2.cvtColor(np.clip(p, 0, 255).astype(np.uint8), cv2.COLOR_GRAY2BGR) for p in shown]
    camera = truth.trajectory.camera.scaled(lasting.shape[1] / truth.trajectory.camera.width)
    for bearing in PlumeMap.load(folder / "run" / "map.json").bearings:
        x, y = np.rint(camera.project(bearing.direction_in_cam)).astype(int).tolist()
        cv2.drawMarker(panels[0], (x, y), (0, 160, 255), cv2.MARKER_CROSS, 14, 2)
    return np.hstack(panels)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--seeds", type=int, nargs="+", default=SEEDS)
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=KINDS)
    parser.add_argument("--photos", type=Path, required=True, help="what the bushes are made of")
    parser.add_argument("--amplitude", type=float, help="of the leaks, px; another --work for it")
    parser.add_argument("--bits", type=float, nargs="+", default=(), help="a pixel, of H.264")
    parser.add_argument("--work", type=Path, default=Path("work/still"))
    parser.add_argument("--plot", type=Path, help="a picture of all recordings, one a row")


def main(options: argparse.Namespace) -> None:
    photos = find_photos(options.photos, "validation")
    pictures = []
    for kind in options.kinds:
        for seed in options.seeds:
            folder = options.work / f"{kind}_{seed}"
            scene = still_scene(seed, plume=kind == "leak", amplitude_px=options.amplitude)
            render(folder, scene, "wind" if kind == "wind" else "", photos)
            for each in [folder, *(code(folder, bits) for bits in options.bits)]:
                print(evaluate_recording(each), flush=True)
            if options.plot:
                pictures.append(picture(folder))
    if options.plot:
        write_image(options.plot, np.vstack(pictures))
