"""What single-frame detectors see, on samples that nothing was trained, chosen or calibrated on.

    OMP_NUM_THREADS=1 python benchmarks/detectors.py table --networks A.onnx A-int8.onnx \\
        --test SAMPLES --validation SAMPLES [--plot auroc_by_peak.png] [--every 1]
    ... shift     --networks A.onnx A-int8.onnx [--photos DIR]
    ... blobs     --networks A.onnx --photos DIR --others DIR
    ... speed     --networks A.onnx A-int8.onnx [--photos DIR] [--paper]

A pixel is positive where |w| > 0.06 px, negative where |w| < 0.02 px; those between are left out of
everything but the magnitude error. Every 5th row and column of a sample is looked at. Columns:
AUROC and average precision (AP) of the score, for dybs its llr before the bounds; EPE, the mean
length of the error over positives, beside that of an answer of zero; magnitude error, the mean of
||answer| - |w|| over all pixels of samples with a plume, beside the mean |w|; r, the correlation of
both components over positives; ECE, the expected calibration error of the stated probability, in 15
bins, where the detector speaks; precision and recall of llr > 2, the default mask; speaks, the
share of pixels with any evidence. The null knows the place in the frame and nothing else: the share
of positives there in the validation samples.
"""

import argparse
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np

from detect.calibration import expected_calibration_error, posterior
from detect.detection import Detection, Frames
from detect.dybs import DybsDetector
from detect.dybs.demodulation import demodulate_lattice
from detect.dybs.detector import CLASS_NAMES
from detect.dybs.edges import measure_edges
from detect.dybs.estimator import WHITE, Estimate, RefinedMeasurement, combine_estimates
from detect.dybs.pattern_measurement import PatternMeasurement, measure_pattern
from detect.dybs.refinement import RefinementNetwork
from detect.learning.dybs_calibration import labels_of
from detect.network import Network
from detect.scores import auroc, average_precision
from detect.synthesis import FAMILIES, Recipe, Sample, Sources, shards_in
from detect.synthesis.camera import MARGIN_PX, Optics, expose
from detect.synthesis.raster import photos_in
from detect.synthesis.sample import draw_background
from detect.texture import texture_classes
from geometry.arrays import FloatMap, GreyImage

MASK_NATS = 2.0
THIN = (slice(2, None, 5),) * 2
PEAKS_PX = (0.08, 0.12, 0.18, 0.27, 0.4, 0.6, 1.1)
SHIFTS_PX = (0.0, 0.125, 0.25, 0.5)
BACKGROUNDS = 12
LONGEST_SIDE_PX = 1024
SHAPE = (480, 640)
POOL_PX, WAVES_FLOOR = 5.0, 0.3
"""The floor keeps the logarithm of still air finite."""
LATTICES = ("sinusoid", "checkerboard")


@dataclass(frozen=True, kw_only=True)
class Answer:
    """Of one contender on one image, (H, W) each; None where it does not say."""

    score: FloatMap
    displacement: FloatMap | None = None
    probability: FloatMap | None = None
    llr: FloatMap | None = None


def planes(image: GreyImage, channels: int = 1) -> FloatMap:
    return np.broadcast_to(image.astype(np.float32) / np.float32(WHITE), (channels, *image.shape))


class Contenders:
    """Everything that is compared."""

    def __init__(self, paths: Sequence[Path], null: FloatMap) -> None:
        self._detectors = {Network(path).name: DybsDetector(path) for path in paths}
        self._null = null

    def answers(self, image: GreyImage) -> Iterator[tuple[str, Answer]]:
        yield "null", Answer(score=self._null)
        measurement = RefinedMeasurement.of_image(
            image, next(iter(self._detectors.values())).estimator.refinement
        )
        yield "waves alone", waves_alone(measurement.measured, image.shape)
        says = measurement.refined or {"logit": np.zeros(image.shape, np.float32)}
        yield "judge alone", Answer(score=says["logit"], displacement=says.get("displacement"))
        for name, detector in self._detectors.items():
            seen = detector.estimator.network_maps(image)
            yield f"{name} alone", Answer(score=seen["logit"], displacement=seen["displacement"])
            estimate = combine_estimates(seen, measurement)
            judged = detector.to_detection(estimate)
            yield (
                f"dybs, {name}",
                Answer(
                    score=unbounded(detector, estimate),
                    displacement=judged.displacement,
                    probability=probability(detector, estimate, judged),
                    llr=judged.llr,
                ),
            )


def waves_alone(measured: PatternMeasurement, shape: tuple[int, ...]) -> Answer:
    """The waves' displacement; its score is the size in their own sigmas, pooled."""
    displacement = measured.displacement * measured.lattice[..., None]
    size_px = np.linalg.norm(displacement, axis=-1).astype(np.float32)
    pooled = cv2.GaussianBlur(size_px, (0, 0), POOL_PX / 2) * np.sqrt(measured.certainty)
    score = np.where(measured.lattice, np.log(pooled + WAVES_FLOOR), 0)
    size = (2 * score.shape[1], 2 * score.shape[0])
    inside = tuple(slice(side) for side in shape)
    return Answer(
        score=cv2.resize(score.astype(np.float32), size)[inside],
        displacement=cv2.resize(displacement, size)[inside],
    )


def unbounded(detector: DybsDetector, estimate: Estimate) -> FloatMap:
    calibration = detector.calibration
    bounds = (-np.inf, np.inf)
    return calibration.llr(estimate.scores, estimate.texture, CLASS_NAMES, most=bounds)


def probability(detector: DybsDetector, estimate: Estimate, seen: Detection) -> FloatMap:
    """What the evidence makes of each class's share of positives in the validation samples."""
    stated = np.full(seen.llr.shape, np.nan, np.float32)
    for name, scale in detector.calibration.scales.items():
        members = estimate.texture == CLASS_NAMES.index(name)
        stated[members] = posterior(seen.llr[members], scale.prior)
    return stated


def null_map(folder: Path) -> FloatMap:
    """Share of positives by place, smooth."""
    positive = sum(labels_of(sample)[0].astype(np.float32) for sample in samples_in(folder, 1))
    return np.asarray(cv2.GaussianBlur(np.asarray(positive), (0, 0), 8))


def samples_in(folder: Path, every: int) -> Iterator[Sample]:
    for shard in shards_in(folder):
        yield from (shard.sample(i) for i in range(0, len(shard), every))


class Tally:
    """Thinned pixels of one contender on one family."""

    def __init__(self) -> None:
        self._parts: defaultdict[str, list[np.ndarray]] = defaultdict(list)

    def add(self, sample: Sample, answer: Answer) -> None:
        positive, counts = (map_[THIN].ravel() for map_ in labels_of(sample))
        truth = sample.displacement[THIN].reshape(-1, 2)
        said = np.zeros_like(truth)
        if answer.displacement is not None:
            said = answer.displacement[THIN].reshape(-1, 2)
        columns = {"positive": positive, "counts": counts, "truth": truth, "said": said}
        columns["score"] = answer.score[THIN].ravel()
        columns["peak"] = np.full(len(truth), np.linalg.norm(sample.displacement, axis=-1).max())
        for name in ("probability", "llr"):
            values = getattr(answer, name)
            columns[name] = np.full(len(truth), np.nan) if values is None else values[THIN].ravel()
        for name, values in columns.items():
            self._parts[name].append(values)

    def __getitem__(self, name: str) -> np.ndarray:
        return np.concatenate(self._parts[name])

    def row(self, *, moves: bool) -> str:
        counts, positive = self["counts"], self["positive"]
        score, label = self["score"][counts], positive[counts]
        cells = [f"{auroc(score, label):.3f}", f"{average_precision(score, label):.3f}"]
        cells += self._displacement(positive) if moves else [""] * 3
        return " | ".join(cells + self._belief(counts, positive))

    def _displacement(self, positive: np.ndarray) -> list[str]:
        truth, said = self["truth"], self["said"]
        error = np.linalg.norm(said - truth, axis=-1)[positive].mean()
        zero = np.linalg.norm(truth, axis=-1)[positive].mean()
        sizes = np.linalg.norm(said, axis=-1), np.linalg.norm(truth, axis=-1)
        with_plume = self["peak"] > 0
        magnitude = np.abs(sizes[0] - sizes[1])[with_plume].mean()
        both = said[positive].ravel(), truth[positive].ravel()
        r = np.corrcoef(*both)[0, 1] if np.ptp(both[0]) > 0 else 0.0
        return [f"{error:.3f} / {zero:.3f}",
                f"{magnitude:.4f} / {sizes[1][with_plume].mean():.4f}", f"{r:.2f}"]  # fmt: skip

    def _belief(self, counts: np.ndarray, positive: np.ndarray) -> list[str]:
        llr = self["llr"]
        if not np.isfinite(llr).any():
            return [""] * 4
        stated = self["probability"]
        judged = counts & (llr != 0)
        ece = expected_calibration_error(stated[judged], positive[judged])
        mask = (llr > MASK_NATS) & counts
        precision = f"{positive[mask].mean():.2f} of {mask.sum()}" if mask.any() else "silent"
        recall = (llr > MASK_NATS)[positive].mean()
        return ["" if np.isnan(ece) else f"{ece:.3f}", precision, f"{recall:.2f}",
                f"{(llr != 0).mean():.2f}"]  # fmt: skip

    def by_peak(self) -> list[float]:
        """AUROC of the positives of plumes in each range of peaks against all negatives."""
        score, positive, peak = self["score"], self["positive"], self["peak"]
        negative = self["counts"] & ~positive
        found = []
        for low, high in pairwise(PEAKS_PX):
            rows = negative | (positive & (peak >= low) & (peak < high))
            found.append(auroc(score[rows], positive[rows]))
        return found


def table(options: argparse.Namespace) -> None:
    contenders = Contenders(options.networks, null_map(options.validation))
    tallies: defaultdict[tuple[str, str], Tally] = defaultdict(Tally)
    for sample in samples_in(options.test, options.every):
        for name, answer in contenders.answers(sample.image):
            tallies[sample.family, name].add(sample, answer)
    print("| background | contender | AUROC | AP | EPE / of zero, px | magnitude error at mean, px "
          "| r | ECE | precision | recall | speaks |\n|" + "---|" * 11)  # fmt: skip
    for family in FAMILIES:
        for (of, name), tally in tallies.items():
            if of == family and (name != "waves alone" or family in LATTICES):
                print(f"| {family} | {name} | {tally.row(moves=name != 'null')} |", flush=True)
    if options.plot:
        first = Network(options.networks[0]).name
        names = ("null", "waves alone", "judge alone", f"{first} alone", f"dybs, {first}")
        curves = {}
        for family in ("sinusoid", "checkerboard", "lines", "scene"):
            shown = [name for name in names if family in LATTICES or name != "waves alone"]
            curves[family] = {name: tallies[family, name].by_peak() for name in shown}
            for name, values in curves[family].items():
                print(f"AUROC by peak, {family}, {name}: {' '.join(f'{v:.3f}' for v in values)}")
        cv2.imwrite(str(options.plot), plot(curves))


def plot(curves: dict[str, dict[str, list[float]]]) -> np.ndarray:
    """One panel a family: AUROC against the peak of the plume, on a logarithmic axis."""
    colours = [(150, 150, 150), (60, 160, 60), (160, 60, 160), (200, 120, 30), (30, 60, 200)]
    middles = np.sqrt(np.multiply(PEAKS_PX[:-1], PEAKS_PX[1:]))
    columns = 60 + (np.log(middles) - np.log(0.08)) / np.log(1.1 / 0.08) * 300
    panels = []
    for family, lines in curves.items():
        panel = np.full((364, 400, 3), 255, np.uint8)
        for value in (0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0):
            row = round(260 - (value - 0.4) / 0.6 * 220)
            cv2.line(panel, (60, row), (360, row), (225, 225, 225), 1)
            text(panel, f"{value:.1f}", (30, row + 4))
        for column, peak in zip(columns, middles, strict=True):
            text(panel, f"{peak:.2f}", (round(column) - 14, 276))
        text(panel, f"{family}: AUROC by peak, px", (60, 24))
        for k, (name, values) in enumerate(lines.items()):
            colour = colours[k if len(lines) == len(colours) or k == 0 else k + 1]
            rows = 260 - (np.clip(values, 0.4, 1) - 0.4) / 0.6 * 220
            known = np.isfinite(rows)
            points = np.stack([columns, rows], axis=-1)[known].round().astype(np.int32)
            cv2.polylines(panel, [points], False, colour, 2, cv2.LINE_AA)
            text(panel, name, (60, 296 + 14 * k), colour)
        panels.append(panel)
    return np.hstack(panels)


def text(panel: np.ndarray, words: str, at: tuple[int, int], colour: tuple = (60, 60, 60)) -> None:
    cv2.putText(panel, words, at, cv2.FONT_HERSHEY_SIMPLEX, 0.38, colour, 1, cv2.LINE_AA)


def shift(options: argparse.Namespace) -> None:
    """Mean probability of refraction on undistorted images that are merely shifted."""
    print("| network | background | " + " | ".join(f"{s} px" for s in SHIFTS_PX)
          + " | largest change | of the mask's llr > 2 |\n|" + "---|" * 8)  # fmt: skip
    detectors = [DybsDetector(path) for path in options.networks]
    for family in FAMILIES:
        if family == "photo" and not options.photos:
            continue
        recipe = Recipe(families={family: 1}, split="test", photos=options.photos)
        shifted = [shifted_images(recipe, family, px) for px in SHIFTS_PX]
        for detector in detectors:
            estimates = [
                [detector.estimator.estimate(image) for image in images] for images in shifted
            ]
            masked = [np.mean([detector.to_detection(one).llr > MASK_NATS for one in some])
                      for some in estimates]  # fmt: skip
            change = f"{np.ptp(masked):.4f}"
            print_shift(
                detector.estimator.network.name,
                family,
                [stated(some, 0) for some in estimates],
                change,
            )
        print_shift("judge", family, [stated(some, 1) for some in estimates], "")


def stated(estimates: Sequence[Estimate], score: int) -> float:
    """Mean probability by one of the scores, where there is one."""
    logits = np.concatenate([estimate.scores[..., score].ravel() for estimate in estimates])
    told = logits != 0
    return float(np.mean(1 / (1 + np.exp(-logits[told])))) if told.any() else float("nan")


def print_shift(name: str, family: str, means: Sequence[float], change: str) -> None:
    if np.isfinite(means).all():
        print(f"| {name} | {family} | " + " | ".join(f"{p:.4f}" for p in means)
              + f" | {np.ptp(means):.4f} | {change} |", flush=True)  # fmt: skip


def shifted_images(recipe: Recipe, family: str, shift_px: float) -> list[GreyImage]:
    """The same backgrounds, noise and camera at every shift."""
    sources = Sources.of(recipe)
    side = recipe.size_px + 2 * MARGIN_PX
    still, images = np.zeros((side, side, 2), np.float32), []
    for number in range(BACKGROUNDS):
        rng = np.random.default_rng([7, number])
        background = draw_background(family, rng, recipe, sources)
        optics = Optics(noise=1.0)
        images.append(expose(background, [still], np.array([shift_px, 0]), optics, rng))
    return images


def blobs(options: argparse.Namespace) -> None:
    """What the default mask holds on photos without a plume that nothing was trained on."""
    groups = {"photos of the test split": list(photos_in(options.photos, "test"))}
    for folder in sorted(options.others.iterdir()) if options.others else []:
        found = [p for p in sorted(folder.rglob("*")) if p.suffix.lower() in {".jpg", ".png"}]
        groups[folder.name] = found
    print("| network | photos | number | false blobs | per 100 | share of pixels that speak |\n|"
          + "---|" * 6)  # fmt: skip
    for path in options.networks:
        detector, every, all_blobs = DybsDetector(path), 0, 0
        for name, photos in groups.items():
            llrs = [detected(detector, photo(p)).llr for p in photos]
            count = sum(
                cv2.connectedComponents((x > MASK_NATS).astype(np.uint8))[0] - 1 for x in llrs
            )
            every, all_blobs = every + len(photos), all_blobs + count
            speaks = np.mean([(llr != 0).mean() for llr in llrs])
            print(f"| {path.stem} | {name} | {len(photos)} | {count} | "
                  f"{100 * count / len(photos):.1f} | {speaks:.3f} |", flush=True)  # fmt: skip
        print(f"| {path.stem} | all | {every} | {all_blobs} | {100 * all_blobs / every:.1f} | |")


def detected(detector: DybsDetector, image: GreyImage) -> Detection:
    return detector.detect(Frames(images=[image]), 0)


def photo(path: Path) -> GreyImage:
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    scale = LONGEST_SIDE_PX / max(image.shape)
    if scale < 1:
        image = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return np.asarray(image, dtype=np.uint8)


def speed(options: argparse.Namespace) -> None:
    """CPU time of one thread."""
    image = np.random.default_rng(0).integers(0, 256, SHAPE, dtype=np.uint8)
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    checks = 120 + 60 * np.sin(0.7 * x + 0.1 * y) * np.sin(0.7 * y - 0.1 * x)
    lattice = (checks + image / 100).astype(np.uint8)
    whole = {"on noise": image, "all a lattice": lattice}
    for path in photos_in(options.photos, "test")[:1] if options.photos else []:
        size = SHAPE[::-1]
        whole["on a photo"] = cv2.resize(photo(path), size, interpolation=cv2.INTER_AREA)
    print("| what, 640 x 480, one thread | CPU ms, median | fastest |\n|---|---|---|")
    for path in options.networks:
        network, detector = Network(path), DybsDetector(path)
        timed(f"{network.name}, onnxruntime", lambda n=network: n(planes(image)))
        for name, seen in whole.items():
            timed(f"dybs with it, {name}", lambda d=detector, i=seen: detected(d, i))
    timed("texture classes", lambda: texture_classes(image))
    timed("demodulation, all a lattice", lambda: demodulate_lattice(lattice, np.ones(SHAPE, bool)))
    for name, seen in whole.items():
        if seen is not lattice:
            timed(f"edges, {name}", lambda i=seen: measure_edges(i))
    measured, judge = measure_pattern(lattice, texture_classes(lattice)), RefinementNetwork()
    timed("judge, onnxruntime", lambda: judge(measured, SHAPE))
    if options.paper:
        time_paper(image)


def time_paper(image: GreyImage) -> None:
    """The paper's network with random weights, 64 channels wide."""
    import tempfile

    import torch

    from detect.learning.export import save
    from detect.learning.networks import PaperUNet

    torch.set_num_threads(1)
    network = PaperUNet().eval()
    with tempfile.TemporaryDirectory() as scratch, torch.inference_mode():
        tensor = torch.from_numpy(planes(image)[None])
        timed("the paper's network, torch", lambda: network(tensor), times=3)
        path = save(network, Path(scratch) / "paper.onnx", "paper", 1, {})
        exported = Network(path)
        timed("the paper's network, onnxruntime", lambda: exported(planes(image)), times=3)


def timed(name: str, work: Callable[[], object], times: int = 15) -> None:
    work()
    spent = []
    for _ in range(times):
        start = time.process_time()
        work()
        spent.append(1000 * (time.process_time() - start))
    print(f"| {name} | {np.median(spent):.0f} | {min(spent):.0f} |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    tasks = {"table": table, "shift": shift, "blobs": blobs, "speed": speed}
    parser.add_argument("task", choices=tasks)
    parser.add_argument("--networks", nargs="+", type=Path, required=True)
    parser.add_argument("--test", type=Path)
    parser.add_argument("--validation", type=Path)
    parser.add_argument("--photos", type=Path)
    parser.add_argument("--others", type=Path)
    parser.add_argument("--plot", type=Path)
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--paper", action="store_true")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    tasks[options.task](options)


if __name__ == "__main__":
    main()
