"""What is seen from a moving camera: by how strong a plume, how many views, what arc, what noise.

    OMP_NUM_THREADS=1 python benchmarks/seeing.py film  --quick --work work/seeing --photos DIR
    ... judge --quick --work work/seeing [--json seeing.json] [--plot docs/images/seeing.png]

`film` renders each sequence and measures its key frames, once: what stands in the work folder is
kept, so a stopped run goes on where it stood (`--part K N` does every Nth sequence). `judge` lets
the detectors judge what was measured, and can be repeated when weights change.

Scenes are random plants of seeds that nothing was trained on (310000 and on), filmed on an arc in
24 frames of 320x240 px (`--quick`) or 60 of 640x480 px. Poses are off by 0.03 degrees and 5 mm,
independently. The base case is 0.3 px, noise 1/255, an arc of 40 degrees, 8 key frames; each axis
changes one of these. A pixel is positive where |w| exceeds 0.3 of the plume's amplitude, negative
where it is below 0.01 px; sky is neither. The score is the llr. The ideal observer knows the scene,
the noise and the true w. `ideal` is its matched filter of w in a Gaussian window of 2 px, as wide
as what `registered` measures in, drawn from its own statistics; a network that knows the shape of
plumes looks further and may exceed it. Over the whole plume of one frame the matched filter has the
signal-to-noise ratio `whole_plume_snr`. A plume counts as found within 15 % of the
range; everything else that is reported is false. Medians over scenes.
"""

import argparse
import json
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from zlib import crc32

import cv2
import numpy as np

from detect.detection import Detection, Frames
from detect.dybs import DybsDetector
from detect.fused import SHARED, fused
from detect.kinds import DYBS, REGISTERED
from detect.registered import RegisteredDetector
from detect.registered.measure import Measurement
from detect.scores import auroc, average_precision
from detect.synthesis.raster import photos_in
from detect.warp import blur, gradients
from geometry.arrays import BoolArray, FloatArray, FloatMap
from geometry.npz import open_arrays, save_arrays
from geometry.trajectory import Trajectory
from locate.fusion.fuse import fuse
from locate.fusion.views import Views
from locate.simulation.camera_paths import fly
from locate.simulation.capture import Take, film
from locate.simulation.clips import disturbed
from locate.simulation.compression import h264
from locate.simulation.layouts import random_scene
from locate.simulation.nuisances import NUISANCES, spoiled
from locate.simulation.scene import CameraBlock, Scene
from locate.simulation.writer import LARGEST_HALF

FIRST_SEED = 310_000
POSE_ERROR_DEG = 0.03
PICTURES = 4
ENDS = 4
STILL_PX, PLUME_SHARE = 0.01, 0.3
WINDOW_PX = 2.0
FOUND_SHARE = 0.15
BITS_A_PIXEL = 1e6 / (640 * 480 * 15)
"""Of a video of 1 Mbit/s at 640x480 px and 15 frames a second."""
CODINGS = {"h264_2mbit": 2 * BITS_A_PIXEL, "h264_8mbit": 8 * BITS_A_PIXEL}
MOVING = ("people", "wind", "glints")
SPOILERS = (*[name for name in NUISANCES if name != "h264"], *CODINGS)
COLOURS = {
    "dybs": (150, 150, 150),
    "plain": (60, 160, 60),
    "learned": (200, 120, 30),
    "fused": (30, 60, 200),
    "ideal": (0, 0, 0),
}


@dataclass(frozen=True, kw_only=True)
class Condition:
    """One case; `views` key frames of the sequence are judged."""

    amplitude_px: float = 0.3
    noise: float = 1.0
    arc_deg: float = 40.0
    nuisance: str = ""
    views: int = 8

    def sequence(self, seed: int) -> str:
        spoiler = self.nuisance or "calm"
        return f"{self.amplitude_px:g}px_{self.noise:g}_{self.arc_deg:g}deg_{spoiler}_{seed}"


@dataclass(frozen=True, kw_only=True)
class Scale:
    """How large everything is."""

    seeds: int
    frames: int
    size: tuple[int, int]
    focal_px: float
    keys: int
    axes: dict[str, list[Condition]]


def axes(quick: bool) -> dict[str, list[Condition]]:
    strengths = (0.1, 0.3, 1.0) if quick else (0.05, 0.1, 0.2, 0.3, 0.5, 1.0, 2.0)
    strong = 1.0 if quick else 0.3
    spoilers = [Condition(amplitude_px=a, nuisance=n) for n in ("", *SPOILERS) for a in (strong, 0)]
    return {
        "amplitude": [Condition(amplitude_px=a) for a in strengths],
        "nuisance": spoilers,
        "views": [
            Condition(views=v) for v in ((1, 2, 4, 8) if quick else (1, 2, 4, 8, 16, 30, 60))
        ],
        "arc": [Condition(arc_deg=a) for a in ((15, 40, 90) if quick else (10, 20, 40, 90, 180))],
        "noise": [Condition(noise=n) for n in ((0.5, 1, 3) if quick else (0.5, 1, 2, 3, 5))],
    }


def scale_of(options: argparse.Namespace) -> Scale:
    chosen = axes(options.quick)
    kept = {name: chosen[name] for name in options.axes}
    if options.quick:
        size = (320, 240)
        return Scale(seeds=options.seeds, frames=24, size=size, focal_px=330, keys=8, axes=kept)
    size = (640, 480)
    return Scale(seeds=options.seeds, frames=60, size=size, focal_px=560, keys=16, axes=kept)


def scene_of(condition: Condition, seed: int, scale: Scale) -> Scene:
    scene = random_scene(
        seed,
        plume=condition.amplitude_px > 0,
        amplitude_px=condition.amplitude_px,
        noise=condition.noise,
        frames=scale.frames,
        arc_deg=condition.arc_deg,
    )
    width, height = scale.size
    camera = CameraBlock(width=width, height=height, focal_px=scale.focal_px)
    return scene.model_copy(update={"camera": camera})


def take_of(condition: Condition, scene: Scene, photos: Path | None) -> Take:
    """The nuisance is the same with and without a plume."""
    rng = np.random.default_rng([scene.seed, crc32(condition.nuisance.encode())])
    take = Take(scene=scene)
    if condition.nuisance in MOVING:
        if photos is None:
            raise SystemExit(f"{condition.nuisance} needs --photos")
        every = photos_in(photos, "test")
        if len(every) < PICTURES:
            raise SystemExit(f"{photos}: {len(every)} photos of the test split, give {PICTURES}")
        chosen = rng.choice(len(every), PICTURES, replace=False)
        take = replace(take, photos=tuple(every[i] for i in chosen))
    if condition.nuisance in CODINGS:
        return replace(take, coding=partial(h264, bits_per_pixel=CODINGS[condition.nuisance]))
    return spoiled(take, [condition.nuisance] if condition.nuisance else [], rng)


def record(take: Take, count: int, path: Path) -> None:
    """Renders a take and writes `count` key frames, what was measured of them, and the truth."""
    footage = film(take)
    told = disturbed(footage.trajectory, take.scene.random(13), POSE_ERROR_DEG)
    frames = Frames(images=footage.images, trajectory=told)
    keys = np.linspace(ENDS, len(frames) - 1 - ENDS, count).round().astype(int)
    detector = RegisteredDetector()
    measured = [(key, detector.measure(frames, int(key))) for key in keys]
    known = [(key, *answer) for key, answer in measured if answer is not None]
    arrays = {
        name: np.stack([getattr(m, name) for _, m, _ in known]).clip(-LARGEST_HALF, LARGEST_HALF)
        for name in Measurement.__dataclass_fields__
    }
    truths = [footage.truths[key] for key, _, _ in known]
    save_arrays(
        path,
        keys=np.array([key for key, _, _ in known]),
        inverse_depth_units=np.array([unit for _, _, unit in known]),
        images=np.stack([footage.images[key] for key, _, _ in known]),
        truth=np.stack([t.displacement for t in truths]).astype(np.float16),
        surface=np.stack([np.isfinite(t.depth) for t in truths]),
        **{name: map_.astype(np.float16) for name, map_ in arrays.items()},
    )


@dataclass(frozen=True, kw_only=True)
class Recorded:
    """What `record` wrote, and the poses that the chain is told, of the key frames."""

    images: np.ndarray
    measurements: list[Measurement]
    inverse_depth_units: FloatArray
    truth: FloatMap
    surface: BoolArray
    trajectory: Trajectory
    scene: Scene

    @classmethod
    def load(cls, path: Path, take: Take) -> "Recorded":
        with open_arrays(path, "a filmed sequence") as file:
            maps = {n: file[n].astype(np.float32) for n in Measurement.__dataclass_fields__}
            count = len(file["keys"])
            block = take.scene.camera
            focal_px = block.focal_px * take.focal_factor
            camera = block.model_copy(update={"radial": 0.0, "focal_px": focal_px})
            told = replace(fly(take.scene), camera=camera.build())
            return cls(
                images=file["images"],
                measurements=[
                    Measurement(**{name: map_[k] for name, map_ in maps.items()})
                    for k in range(count)
                ],
                inverse_depth_units=file["inverse_depth_units"],
                truth=file["truth"].astype(np.float32),
                surface=file["surface"],
                trajectory=disturbed(told, take.scene.random(13), POSE_ERROR_DEG).take(
                    file["keys"]
                ),
                scene=take.scene,
            )


class Contenders:
    """Whoever judges; `learned` and `fused` where weights are installed or given."""

    def __init__(self, weights: Path | None) -> None:
        self._plain = RegisteredDetector()
        learned = REGISTERED.find_weights(weights)
        self._learned = None if learned is None else RegisteredDetector(weights=learned)
        dybs = DYBS.find_weights()
        self._dybs = None if dybs is None else DybsDetector(dybs)

    def judge(self, sequence: Recorded, rows: Sequence[int]) -> dict[str, list[Detection]]:
        """The detections of some key frames, by contender."""
        told = defaultdict(list)
        for k in rows:
            measured = sequence.measurements[k], float(sequence.inverse_depth_units[k])
            told["plain"].append(self._plain.judge(*measured))
            best = told["plain"][-1]
            if self._learned is not None:
                best = self._learned.judge(*measured)
                told["learned"].append(best)
            if self._dybs is not None:
                told["dybs"].append(self._dybs.detect(Frames(images=list(sequence.images)), k))
                told["fused"].append(fused(best, told["dybs"][-1], SHARED))
        return told


def labels(sequence: Recorded, rows: Sequence[int]) -> tuple[BoolArray, BoolArray]:
    """(K, H, W) plume, and which pixels count."""
    size = np.linalg.norm(sequence.truth[rows], axis=-1)
    amplitude_px = max((p.amplitude_px or 0.0 for p in sequence.scene.plumes), default=0.0)
    positive = size > max(PLUME_SHARE * amplitude_px, STILL_PX)
    surface = sequence.surface[rows]
    return positive & surface, surface & (positive | (size < STILL_PX))


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
    sequence: Recorded, condition: Condition, contenders: Contenders, *, fusing: bool
) -> dict[str, dict[str, float]]:
    count = len(sequence.measurements)
    rows = np.linspace(0, count - 1, min(condition.views, count)).round().astype(int).tolist()
    positive, counts = labels(sequence, rows)
    told = contenders.judge(sequence, rows)
    maps = {name: np.stack([d.llr for d in detections]) for name, detections in told.items()}
    result = {name: pixel_scores(llr, positive, counts) for name, llr in maps.items()}
    if fusing and len(rows) > 1:
        sources: dict[bytes, dict[str, float]] = {}  # equal evidence is fused once
        for name in told.keys() - {"dybs"}:
            evidence = maps[name].tobytes()
            if evidence not in sources:
                sources[evidence] = source_scores(told[name], sequence, rows)
            result[name] |= sources[evidence]
    if positive.any():
        rng = np.random.default_rng(0)
        result["ideal"] = pixel_scores(ideal(sequence, rows, rng), positive, counts)
        ratios = [whole_plume_snr(sequence, row) for row in rows]
        result["ideal"]["whole_plume_snr"] = float(np.median(ratios))
    return result


def sequences(scale: Scale) -> Iterator[tuple[str, Condition, int]]:
    for axis, conditions in scale.axes.items():
        for seed in range(FIRST_SEED, FIRST_SEED + scale.seeds):
            for condition in conditions:
                yield axis, condition, seed


def film_all(options: argparse.Namespace) -> None:
    scale = scale_of(options)
    wanted = {c.sequence(seed): (c, seed) for _, c, seed in sequences(scale)}
    options.work.mkdir(parents=True, exist_ok=True)
    first, every = options.part
    for name, (condition, seed) in list(wanted.items())[first::every]:
        path = options.work / f"{name}.npz"
        if not path.exists():
            take = take_of(condition, scene_of(condition, seed, scale), options.photos)
            record(take, scale.keys, path)
            print(name, flush=True)


def judge_all(options: argparse.Namespace) -> None:
    scale = scale_of(options)
    contenders = Contenders(options.weights)
    found: defaultdict[str, list[dict[str, dict[str, float]]]] = defaultdict(list)
    for axis, condition, seed in sequences(scale):
        path = options.work / f"{condition.sequence(seed)}.npz"
        if not path.exists():
            continue
        take = take_of(condition, scene_of(condition, seed, scale), options.photos)
        sequence = Recorded.load(path, take)
        label = f"{axis} {label_of(axis, condition)}"
        found[label].append(evaluate(sequence, condition, contenders, fusing=axis in options.fuse))
        print(label, seed, json.dumps(found[label][-1]), flush=True)
    summary = {label: summarised(results) for label, results in found.items()}
    if options.json:
        options.json.write_text(json.dumps(summary, indent=1))
    print(table(summary))
    if options.plot:
        cv2.imwrite(str(options.plot), plot(summary))


def label_of(axis: str, condition: Condition) -> str:
    if axis == "nuisance":
        plume = "with" if condition.amplitude_px else "without"
        return f"{condition.nuisance or 'none'}, {plume} a plume"
    values = {"amplitude": condition.amplitude_px, "noise": condition.noise,
              "arc": condition.arc_deg, "views": condition.views}  # fmt: skip
    return f"{values[axis]:g}"


def summarised(results: list[dict[str, dict[str, float]]]) -> dict[str, dict[str, float]]:
    """Medians over scenes; the share found and the false plumes a scene are means."""
    summary: dict[str, dict[str, float]] = {}
    for name in COLOURS:
        told = [result[name] for result in results if name in result]
        if told:
            means = ("found", "false_plumes")
            keys = sorted({key for scores in told for key in scores})
            summary[name] = {"scenes": len(told)} | {
                key: float(
                    (np.mean if key in means else np.median)([s[key] for s in told if key in s])
                )
                for key in keys
            }
    return summary


def table(summary: dict[str, dict[str, dict[str, float]]]) -> str:
    lines = ["| case | contender | scenes | AUROC | AP | pixels falsely above 1 nat | found "
             "| source error, % of range | false plumes a scene | SNR of the whole plume |",
             "|" + "---|" * 10]  # fmt: skip
    shapes = {"scenes": ".0f", "auroc": ".3f", "ap": ".3f", "false_pixels": ".4f", "found": ".2f",
              "error_percent": ".1f", "false_plumes": ".2f", "whole_plume_snr": ".0f"}  # fmt: skip
    for label, contenders in summary.items():
        for name, scores in contenders.items():
            cells = [f"{scores[key]:{shape}}" if key in scores else ""
                     for key, shape in shapes.items()]  # fmt: skip
            lines.append(f"| {label} | {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def plot(summary: dict[str, dict[str, dict[str, float]]]) -> np.ndarray:
    """A column of panels for each numeric axis, a row for each score."""
    cases = {
        axis: [label for label in summary if label.startswith(f"{axis} ")]
        for axis in ("amplitude", "views", "arc", "noise")
    }
    cases = {axis: found for axis, found in cases.items() if len(found) > 1}
    fused_ = any("found" in scores["plain"] for scores in summary.values())
    rows = [
        np.hstack([panel(summary, labels_, axis, score) for axis, labels_ in cases.items()])
        for score in ("auroc", "ap", *(["found"] if fused_ else []))
    ]
    return np.vstack(rows)


def panel(
    summary: dict[str, dict[str, dict[str, float]]], cases: list[str], axis: str, score: str
) -> np.ndarray:
    image = np.full((300, 360, 3), 255, np.uint8)
    if not any(score in scores for case in cases for scores in summary[case].values()):
        return image
    least = 0.4 if score == "auroc" else 0.0
    for value in np.arange(least, 1.01, 0.1 if least else 0.2):
        row = round(240 - (value - least) / (1 - least) * 200)
        cv2.line(image, (45, row), (345, row), (225, 225, 225), 1)
        text(image, f"{value:.1f}", (18, row + 4))
    values = [float(case.split()[1]) for case in cases]
    units = {"amplitude": "px", "views": "key frames", "arc": "degrees", "noise": "of 255"}
    title = "Share found" if score == "found" else score.upper()
    text(image, f"{title} by {axis}, {units[axis]}", (45, 20))
    place = np.log(values) - np.log(min(values))
    columns = 50 + place / place.max() * 290
    for column, value in zip(columns, values, strict=True):
        text(image, f"{value:g}", (round(column) - 8, 256))
    for k, (name, colour) in enumerate(COLOURS.items()):
        points = [
            (column, 240 - (max(summary[case][name][score], least) - least) / (1 - least) * 200)
            for case, column in zip(cases, columns, strict=True)
            if score in summary[case].get(name, {})
        ]
        if points:
            line = np.round(points).astype(np.int32)
            width = 6 if name == "learned" else 2  # still seen where `fused` is the same
            cv2.polylines(image, [line], False, colour, width, cv2.LINE_AA)
            text(image, name, (20 + 66 * k, 284), colour)
    return image


def text(
    image: np.ndarray, words: str, at: tuple[int, int], colour: tuple[int, int, int] = (60, 60, 60)
) -> None:
    cv2.putText(image, words, at, cv2.FONT_HERSHEY_SIMPLEX, 0.38, colour, 1, cv2.LINE_AA)


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("task", choices=("film", "judge"))
    parser.add_argument("--quick", action="store_true", help="few cases, small frames")
    parser.add_argument("--work", type=Path, default=Path("work/seeing"))
    parser.add_argument("--photos", type=Path, help="single photos, for what moves")
    parser.add_argument("--seeds", type=int, default=2, help="scenes a case")
    parser.add_argument("--axes", nargs="+", default=list(axes(True)), choices=list(axes(True)))
    parser.add_argument("--part", type=int, nargs=2, default=(0, 1), metavar=("K", "N"))
    parser.add_argument("--weights", type=Path, help="of the learned detector")
    parser.add_argument("--fuse", nargs="*", default=list(axes(True)), help="axes with sources")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--plot", type=Path)
    options = parser.parse_args(arguments)
    cv2.setNumThreads(1)
    {"film": film_all, "judge": judge_all}[options.task](options)


if __name__ == "__main__":
    main()
