"""The scores of frames whose truth is known, as a row of a table, and the frames as a picture."""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from detect.detection import Detection
from detect.kinds import DYBS
from detect.scores import auroc
from geometry.arrays import BoolArray, FloatMap, GreyImage
from geometry.image_files import write_image
from locate.export.pictures import displacement_picture

PLUME_PX, STILL_PX, MASK_NATS = 0.06, 0.02, 2.0
HEADER = ("| {what} | frames | magnitude error at mean, px | EPE / of zero, px | r | AUROC | "
          "precision | recall | with evidence | beside objects, px |\n"
          + "|---" * 10 + "|")  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class AnsweredFrame:
    """One frame, what is true of it, and what one method says; (H, W) each."""

    image: GreyImage
    truth: FloatMap
    answer: Detection
    counts: BoolArray
    beside: BoolArray


def score_row(frames: Sequence[AnsweredFrame]) -> str:
    counts = np.stack([seen.counts for seen in frames])
    beside = np.stack([seen.beside for seen in frames])
    truth = np.stack([seen.truth for seen in frames])
    said = np.stack([np.nan_to_num(seen.answer.displacement) for seen in frames])
    llr = np.stack([seen.answer.llr for seen in frames])
    error = np.linalg.norm(said - truth, axis=-1)
    size, size_said = (np.linalg.norm(w, axis=-1) for w in (truth, said))
    plume = counts & (size > PLUME_PX)
    asked = plume | (counts & (size < STILL_PX))
    mask = counts & (llr > MASK_NATS)
    judged = mask & asked
    r = np.corrcoef(said[plume].ravel(), truth[plume].ravel())[0, 1] if said.any() else 0.0
    cells = [
        f"{np.abs(size_said - size)[counts].mean():.4f} / {size[counts].mean():.4f}",
        f"{error[plume].mean():.3f} / {size[plume].mean():.3f}",
        f"{r:.2f}",
        f"{auroc(llr[asked], plume[asked]):.3f}",
        f"{plume[judged].mean():.2f}" if judged.any() else "none",
        f"{mask[plume].mean():.2f}",
        f"{(llr != 0)[counts].mean():.2f}",
    ]
    near = error[beside & counts]
    cells.append(f"{near.mean():.3f}, {np.percentile(near, 99):.2f}" if near.size else "")
    return f"{len(frames)} | " + " | ".join(cells)


def draw_strip(image: GreyImage, *fields: FloatMap, side: int) -> np.ndarray:
    """The image and displacements beside each other; all share the scale of the first field."""
    scale = float(np.linalg.norm(fields[0], axis=-1).max())
    panels = [cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)]
    panels += [displacement_picture(field, full_scale_px=scale) for field in fields]
    width = round(side * image.shape[1] / image.shape[0])
    small = [cv2.resize(panel, (width, side), interpolation=cv2.INTER_AREA) for panel in panels]
    white = np.full((side, 4, 3), 255, np.uint8)
    return np.hstack([part for panel in small for part in (panel, white)])


def add_detector_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--network", type=Path, default=DYBS.installed_weights)
    parser.add_argument("--picture", type=Path)


def write_picture(path: Path | None, strips: Sequence[np.ndarray]) -> None:
    """The strips below each other, if a path is given."""
    if path is not None:
        gaps = [np.full((4, *strips[0].shape[1:]), 255, np.uint8)] * len(strips)
        parts = [part for pair in zip(strips, gaps, strict=True) for part in pair]
        write_image(path, np.vstack(parts))
