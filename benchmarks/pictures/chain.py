"""What the stages of a run see: a frame, its displacement, its evidence, and the sum over views.

    python -m benchmarks.pictures chain out/demo -o docs/images/chain.jpg

Takes the folder of a run that found a plume, such as that of `locate demo`. The last panel is the
summed evidence from above, with the cameras (blue), the source and its 2-sigma ellipse (white).
"""

import argparse
from pathlib import Path

import cv2
import numpy as np

from benchmarks.common.plots import blank, text
from detect.detection import Detection
from detect.evidence import LLR_MAX
from geometry.arrays import FloatArray
from geometry.errors import BadInputError
from geometry.image_files import write_image
from geometry.npz import read_npz
from geometry.trajectory import Trajectory
from locate.export.pictures import displacement_picture, heat_colours, overlay_evidence
from locate.map.plume import Plume, PlumeMap
from locate.pipeline.files import RunFiles
from locate.recording.images import read_grey

WIDTH_PX, LABEL_PX = 400, 20
BLUE, WHITE = (138, 95, 43), (255, 255, 255)


def seen_from_above(files: RunFiles, plume: Plume, size: tuple[int, int]) -> np.ndarray:
    """(H, W, 3) the strongest evidence of each upright line of voxels."""
    grid = read_npz(files.evidence)
    centers = Trajectory.load(files.trajectory).centers_in_world[:, :2]
    corner, voxel = grid["low_in_world"][:2], float(grid["voxel"])
    top = grid["llr"].astype(np.float32).max(axis=0)
    far = corner + voxel * np.array(top.shape[::-1])
    low = np.minimum(corner, centers.min(axis=0)) - 0.5
    high = np.maximum(far, centers.max(axis=0)) + 0.5
    width, height = size
    scale = min(width / (high - low)[0], height / (high - low)[1])

    def pixel(point: FloatArray) -> tuple[int, int]:
        x, y = (point[:2] - low) * scale
        return round(float(x)), round(float(height - 1 - y))

    side = round(float(voxel * top.shape[1] * scale)), round(float(voxel * top.shape[0] * scale))
    strength = np.clip(top / max(float(top.max()), 1e-6), 0, 1)
    heat = cv2.resize(heat_colours(strength)[::-1], side, interpolation=cv2.INTER_AREA)
    canvas = np.full((height, width, 3), 20, np.uint8)
    left, bottom = pixel(corner)
    first = max(bottom - side[1], 0)
    heat = heat[-(bottom - first) :, : width - left]
    canvas[first:bottom, left : left + heat.shape[1]] = heat
    for center in centers:
        cv2.circle(canvas, pixel(center), 3, BLUE, -1, cv2.LINE_AA)
    spread, axes = np.linalg.eigh(plume.source_covariance[:2, :2])
    half = tuple(max(2, round(float(2 * sigma * scale))) for sigma in np.sqrt(spread))
    turn = -float(np.degrees(np.arctan2(axes[1, 0], axes[0, 0])))
    cv2.ellipse(canvas, pixel(plume.source), half, turn, 0, 360, WHITE, 1, cv2.LINE_AA)
    return canvas


def labelled(picture: np.ndarray, words: str) -> np.ndarray:
    height = round(picture.shape[0] * WIDTH_PX / picture.shape[1])
    shown = cv2.resize(picture, (WIDTH_PX, height), interpolation=cv2.INTER_AREA)
    label = blank(LABEL_PX, WIDTH_PX)
    text(label, words, (4, 14))
    return np.vstack([shown, label])


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("run", type=Path, help="The folder of a run.")
    parser.add_argument("-o", "--output", type=Path, default=Path("work/chain.jpg"))


def main(options: argparse.Namespace) -> None:
    files = RunFiles(options.run)
    plume_map = PlumeMap.load(files.map)
    if not plume_map.plumes:
        raise BadInputError(f"{files.map}: no plume to show")
    plume = plume_map.plumes[0]
    index = plume.views[len(plume.views) // 2]
    image = read_grey(files.frames / f"{index:06d}.png")
    seen = Detection.load(files.detections / f"{index:06d}.npz")
    frame = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
    measured = np.where(np.isfinite(seen.sigma_px)[..., None], seen.displacement, 0)
    size = (image.shape[1], image.shape[0])
    panels = [
        labelled(frame, "a frame"),
        labelled(displacement_picture(measured, 1.0), "its displacement, colour by direction"),
        labelled(overlay_evidence(image, seen.llr, LLR_MAX), "its evidence"),
        labelled(seen_from_above(files, plume, size), "all views, from above"),
    ]
    options.output.parent.mkdir(parents=True, exist_ok=True)
    rows = [np.hstack(panels[:2]), np.hstack(panels[2:])]
    write_image(options.output, np.vstack(rows), [cv2.IMWRITE_JPEG_QUALITY, 85])
