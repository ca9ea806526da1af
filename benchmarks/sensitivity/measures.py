"""The scores of a sequence, and the ideal observer."""

from collections.abc import Sequence

import numpy as np

from benchmarks.common.filmed import FOUND_SHARE, Recorded, labels
from benchmarks.sensitivity.conditions import Condition
from benchmarks.sensitivity.contenders import ComparedDetectors
from detect.detection import Detection
from detect.scores import auroc, average_precision
from detect.warp import blur, gradients
from geometry.arrays import BoolArray, FloatMap
from locate.fusion.fuse import fuse
from locate.fusion.views import Views

WINDOW_PX = 2.0


def ideal(sequence: Recorded, rows: Sequence[int], rng: np.random.Generator) -> FloatMap:
    """(K, H, W) log-likelihood ratios of an observer who knows all but whether there is a plume.

    Where there is none, it looks for the w of a random place in the plume. Its detectability is
    d^2 = sum of (gradient . w)^2 over the window / noise^2, the llr normal about +-d^2/2 with
    variance d^2.
    """
    noise = sequence.scene.image.noise
    positive, counts = labels(sequence, rows)
    maps = []
    for k, row in enumerate(rows):
        smooth = blur(sequence.images[row].astype(np.float32), 0.7)
        gx, gy = gradients(smooth)
        w = sequence.truth[row].copy()
        there = np.flatnonzero(positive[k])
        if len(there):
            elsewhere = ~positive[k]
            w[elsewhere] = w.reshape(-1, 2)[rng.choice(there, int(elsewhere.sum()))]
        window_px2 = 4 * np.pi * WINDOW_PX**2
        signal = blur((gx * w[..., 0] + gy * w[..., 1]) ** 2, WINDOW_PX)
        squared = window_px2 * signal / (noise**2 + 1 / 12)
        sign = np.where(positive[k], 0.5, -0.5)
        maps.append(sign * squared + np.sqrt(squared) * rng.standard_normal(squared.shape))
    return np.where(counts, np.stack(maps), 0).astype(np.float32)


def whole_plume_snr(sequence: Recorded, row: int) -> float:
    """Of the true plume's matched filter over one frame whose scene is known."""
    gx, gy = gradients(blur(sequence.images[row].astype(np.float32), 0.7))
    w = sequence.truth[row]
    signal = (gx * w[..., 0] + gy * w[..., 1])[sequence.surface[row]]
    return float(np.sqrt((signal**2).sum() / (sequence.scene.image.noise**2 + 1 / 12)))


def pixel_scores(llr: FloatMap, positive: BoolArray, counts: BoolArray) -> dict[str, float]:
    scores: dict[str, float] = {"false_pixels": float((llr[counts & ~positive] > 1).mean())}
    if positive.any():
        scores["auroc"] = auroc(llr[counts], positive[counts])
        scores["ap"] = average_precision(llr[counts], positive[counts])
        scores["prior"] = float(positive[counts].mean())
    return scores


def source_scores(
    detections: list[Detection], sequence: Recorded, rows: Sequence[int]
) -> dict[str, float]:
    """Whether the plume was found, how far off in % of range, and how many others."""
    trajectory = sequence.trajectory.take(rows)
    plumes = fuse(Views.from_detections(detections, trajectory)).plumes
    if not sequence.scene.plumes:
        return {"false_plumes": float(len(plumes))}
    source = np.array(sequence.scene.plumes[0].source)
    range_m = float(np.linalg.norm(trajectory.centers_in_world - source, axis=1).mean())
    errors = [float(np.linalg.norm(plume.source - source)) / range_m for plume in plumes]
    hits = [error for error in errors if error < FOUND_SHARE]
    scores = {"found": float(bool(hits)), "false_plumes": float(len(errors) - bool(hits))}
    return scores | ({"error_percent": 100 * min(hits)} if hits else {})


def evaluate(
    sequence: Recorded, condition: Condition, contenders: ComparedDetectors, *, fusing: bool
) -> dict[str, dict[str, float]]:
    count = len(sequence.measurements)
    rows = np.linspace(0, count - 1, min(condition.views, count)).round().astype(int).tolist()
    positive, counts = labels(sequence, rows)
    found = contenders.detect(sequence, rows)
    maps = {name: np.stack([d.llr for d in detections]) for name, detections in found.items()}
    result = {name: pixel_scores(llr, positive, counts) for name, llr in maps.items()}
    if fusing and len(rows) > 1:
        sources: dict[bytes, dict[str, float]] = {}  # equal evidence is fused once
        for name in found.keys() - {"dybs"}:
            evidence = maps[name].tobytes()
            if evidence not in sources:
                sources[evidence] = source_scores(found[name], sequence, rows)
            result[name] |= sources[evidence]
    if positive.any():
        rng = np.random.default_rng(0)
        result["ideal"] = pixel_scores(ideal(sequence, rows, rng), positive, counts)
        ratios = [whole_plume_snr(sequence, row) for row in rows]
        result["ideal"]["whole_plume_snr"] = float(np.median(ratios))
    return result
