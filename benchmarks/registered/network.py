"""What a network over registered neighbours adds to the scores made by hand.

    OMP_NUM_THREADS=1 python benchmarks/registered_learned.py render FOLDER [--scenes 6]
    ... table NETWORK.onnx FOLDER
    ... lessons NETWORK.onnx LESSONS... [--seeds FIRST END]...
    ... speed NETWORK.onnx [--run RUN]

`render` makes test clips of 320 x 240 px, a folder for each strength and noise: layouts of the
same generator as the training's, of seeds that nothing was trained, chosen or calibrated on
(300000 and on), poses off by up to 0.1 degrees. A pixel is positive where |w| exceeds 0.3 of the
plume's amplitude, negative where it is below 0.01 px, neither in between; sky and everything that
is not measured counts as neither. `plain` is `registered-plain`. EPE is the mean error over
positives, beside that of an answer of zero. The reliability says what a stated llr is worth: the
log of the share of positives over the share of negatives whose llr lies there, and by how much
that scatters (standard deviation) where as many recordings are drawn from these with replacement;
plants of one seed count as one recording.
"""

import argparse
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from benchmarks.scenes.limit import recorded
from detect.evidence import LLR_MAX, LLR_MIN, displacement_evidence
from detect.learning.clips import KINDS, TrainingClip, clip_path, clip_seed, list_clips
from detect.learning.registered_calibration import Read, chosen, read_clip
from detect.registered.detector import RegisteredDetector, displacement_sigma
from detect.registered.detector import trust as trust_in
from detect.registered.features import FEATURES, SMALL_PX, feature, features
from detect.registered.learned import CLASS_NAMES, Reader
from detect.scores import auroc, average_precision
from geometry.arrays import FloatMap
from locate.pipeline.detections import spread_rows
from locate.pipeline.points import load_points

FIRST_SEED = 300_000
CONDITIONS = ((1.0, 1.0), (0.3, 1.0), (0.3, 3.0), (0.1, 1.0), (0.0, 1.0), (0.0, 3.0))
THIN = (slice(1, None, 4),) * 2
BINS = np.array([LLR_MIN, -1, -0.5, 0.5, 1, 1.5, 2, 2.5, 3, 3.5, LLR_MAX])
FEWEST = 50
DRAWN = 200
NEAR = 0.3
KEY_FRAMES = 16


def name_of(amplitude_px: float, noise: float) -> str:
    return f"{amplitude_px:.1f}px_noise{noise:.0f}"


def render(options: argparse.Namespace) -> None:
    from locate.simulation.capture import Take, film
    from locate.simulation.clips import draw_clip_scene, measured

    for seed in range(FIRST_SEED, FIRST_SEED + options.scenes):
        for amplitude_px, noise in CONDITIONS:
            path = clip_path(options.folder / name_of(amplitude_px, noise), seed)
            if path.exists():
                continue
            path.parent.mkdir(parents=True, exist_ok=True)
            scene = draw_clip_scene(seed, plume=amplitude_px > 0)
            plumes = [p.model_copy(update={"amplitude_px": amplitude_px}) for p in scene.plumes]
            image = scene.image.model_copy(update={"noise": noise})
            scene = scene.model_copy(update={"plumes": plumes, "image": image})
            measured(film(Take(scene=scene)), scene.random(13)).save(path)


def by_hand(read: Read) -> tuple[FloatMap, FloatMap]:
    """(H, W) llr and (H, W, 2) displacement that `registered-plain` has for these features."""
    displacement = SMALL_PX * np.sinh(np.moveaxis(read.inputs[:2], 0, -1).astype(np.float32))
    log_sigma = read.inputs[FEATURES.index("log_sigma")].astype(np.float32)
    sigma_px = np.where(read.opinion.measured, SMALL_PX * np.exp(log_sigma), np.inf)
    inputs = read.inputs
    trust = trust_in(feature(inputs, "visible"), feature(inputs, "log_depth_edge"))
    texture = feature(inputs, "log_texture")
    llr, _ = displacement_evidence(displacement, sigma_px.astype(np.float32), texture, trust)
    return llr, displacement


class Tally:
    """Thinned pixels of many frames, by contender."""

    def __init__(self, reader: Reader) -> None:
        self._reader, self._calibration = reader, reader.calibration()
        self._columns: defaultdict[str, list[np.ndarray]] = defaultdict(list)

    def add(self, clip: TrainingClip, seed: int) -> None:
        for read in read_clip(self._reader, clip):
            here = read.counts[THIN]
            hand_llr, hand_displacement = by_hand(read)
            opinion = read.opinion
            maps = {
                "positive": read.positive,
                "place": opinion.places,
                "plain": hand_llr,
                "learned": opinion.llr(self._calibration),
                "logit": opinion.scores[..., 0],
                "size": np.linalg.norm(read.truth, axis=-1),
                "sigma": opinion.sigma_px,
                "plain error": np.linalg.norm(hand_displacement - read.truth, axis=-1),
                "learned error": np.linalg.norm(opinion.displacement - read.truth, axis=-1),
            }
            for name, map_ in maps.items():
                self._columns[name].append(map_[THIN][here])
            self._columns["recording"].append(np.full(here.sum(), seed))

    def __getitem__(self, name: str) -> np.ndarray:
        return np.concatenate(self._columns[name])

    def rows(self) -> Iterator[str]:
        """AUROC, AP, share of positives, EPE / of zero, share of llr > 1 in and out of plumes."""
        positive = self["positive"]
        for name, score in (("plain", "plain"), ("learned", "logit")):
            llr, error = self[name], self[f"{name} error"]
            cells = [name, "", "", "", ""]
            if positive.any():
                cells[1:] = [
                    f"{auroc(self[score], positive):.3f}",
                    f"{average_precision(self[score], positive):.3f}",
                    f"{error[positive].mean():.3f} / {self['size'][positive].mean():.3f}",
                    f"{(llr[positive] > 1).mean():.2f}",
                ]
            yield " | ".join([*cells, f"{(llr[~positive] > 1).mean():.4f}"])

    def nees(self) -> str:
        """Mean squared error of a component over sigma squared, in plumes and outside."""
        ratio, positive = self["learned error"] ** 2 / (2 * self["sigma"] ** 2), self["positive"]
        inside = f"{ratio[positive].mean():.2f} in, " if positive.any() else ""
        return f"{inside}{ratio[~positive].mean():.2f} out"


@dataclass(frozen=True, kw_only=True)
class Bin:
    """Nats; `scatter` is a standard deviation of `observed`."""

    observed: float
    scatter: float
    stated: float

    def __str__(self) -> str:
        return f"{self.observed:.1f} ± {self.scatter:.1f} at {self.stated:.1f}"

    @property
    def gap(self) -> float:
        return abs(self.observed - self.stated)


def reliability(llr: np.ndarray, positive: np.ndarray, recording: np.ndarray) -> list[Bin | None]:
    """Of each of `BINS`; the bounds are bins of their own."""
    edges = [*(BINS[:-1] + 1e-3), LLR_MAX - 1e-3]
    silent = len(edges) + 1
    if min(positive.sum(), (~positive).sum()) < FEWEST:
        return [None] * silent
    which = np.where(llr == 0, silent, np.digitize(llr, edges, right=True))
    ids, row = np.unique(recording, return_inverse=True)
    counts = np.zeros((2, len(ids), silent + 1))
    np.add.at(counts, (positive.astype(int), row, which), 1)
    again = np.random.default_rng(0).multinomial(len(ids), np.ones(len(ids)) / len(ids), DRAWN)
    told, scatter = observed(counts.sum(axis=1)), observed(again @ counts).std(axis=0)
    fewest = counts.sum(axis=1).min(axis=0)
    return [
        Bin(observed=told[k], scatter=scatter[k], stated=llr[which == k].mean())
        if fewest[k] >= FEWEST
        else None
        for k in range(silent)
    ]


def observed(counts: np.ndarray) -> np.ndarray:
    """(..., B) nats, of (2, ..., B) pixels of either kind; half a pixel more, so none is empty."""
    misses, hits = np.log((counts + 0.5) / counts.sum(axis=-1, keepdims=True))
    return np.asarray(hits - misses)


def table(options: argparse.Namespace) -> None:
    reader = Reader(options.network)
    print("| amplitude, noise | contender | AUROC | AP | EPE / of zero, px | llr > 1 in plumes "
          "| outside |\n|" + "---|" * 7)  # fmt: skip
    tallies = {}
    for amplitude_px, noise in CONDITIONS:
        tally = Tally(reader)
        for path in list_clips(options.folder / name_of(amplitude_px, noise)):
            tally.add(TrainingClip.load(path), clip_seed(path))
        tallies[f"{amplitude_px:.1f} px, {noise:.0f}/255"] = tally
        for row in tally.rows():
            print(f"| {amplitude_px:.1f} px, {noise:.0f}/255 | {row} |", flush=True)
    print_reliability(tallies)


def clips(options: argparse.Namespace) -> None:
    reader = Reader(options.network)
    tallies: defaultdict[str, Tally] = defaultdict(lambda: Tally(reader))
    for path in chosen(options.lessons, options.seeds):
        clip = TrainingClip.load(path)
        tallies[KINDS[clip.kind]].add(clip, clip_seed(path))
    print("| strength | contender | AUROC | AP | EPE / of zero, px | llr > 1 in plumes "
          "| outside |\n|" + "---|" * 7)  # fmt: skip
    for kind in sorted(tallies, key=KINDS.index):
        for row in tallies[kind].rows():
            print(f"| {kind} | {row} |", flush=True)
    print_reliability(tallies)


def cells(bins: Sequence[Bin | None]) -> str:
    return " | ".join(str(one or "") for one in bins)


def print_reliability(tallies: dict[str, Tally]) -> None:
    columns = {
        name: np.concatenate([tally[name] for tally in tallies.values()])
        for name in ("learned", "positive", "place", "recording")
    }
    print("\n| reliability | " + " | ".join(f"to {high:g}" for high in [*BINS, np.inf]) + " |")
    print("|" + "---|" * (len(BINS) + 2))
    rows = {"all": columns["positive"] | True}
    rows |= {name: columns["place"] == k for k, name in enumerate(CLASS_NAMES)}
    judged: list[Bin] = []
    for name, members in rows.items():
        bins = reliability(*(columns[n][members] for n in ("learned", "positive", "recording")))
        print(f"| {name}, {members.mean():.2f} of pixels | {cells(bins)} |")
        judged += [one for one in bins if one and name != "all"]
    for name, tally in tallies.items():
        if tally["positive"].any():
            bins = reliability(tally["learned"], tally["positive"], tally["recording"])
            print(f"| {name} | {cells(bins)} |")
    for low, high in ((LLR_MIN, 0.5), (0.5, LLR_MAX)):
        some = [one for one in judged if low + 1e-3 < one.stated < high - 1e-3]
        near = sum(one.gap <= NEAR for one in some)
        likely = sum(one.gap <= max(NEAR, 2 * one.scatter) for one in some)
        print(f"{low:g} to {high:g} nats: of {len(some)} bins of classes {near} within {NEAR}, "
              f"{likely} within that or twice the scatter")  # fmt: skip
    for name, tally in tallies.items():
        print(f"NEES of the displacement, {name}: {tally.nees()}")


def cost(name: str, work: Callable[[], object], times: int) -> None:
    spent = []
    for _ in range(times):
        start = time.process_time()
        work()
        spent.append(1000 * (time.process_time() - start))
    print(f"{name}: {min(spent):.1f} ms of CPU at best, median {np.median(spent):.1f}")


def speed(options: argparse.Namespace) -> None:
    reader = Reader(options.network)
    inputs = np.random.default_rng(0).normal(size=(len(FEATURES), 480, 640)).astype(np.float32)
    cost("network at 640 x 480", lambda: reader.network(inputs), 20)
    cost("with what is made of it", lambda: reader.read(inputs), 20)
    if options.run is None:
        return
    frames = recorded(options.run, options.run / "frames").frames()
    points = load_points(options.run / "points.npz")
    detector = RegisteredDetector(points_in_world=points, weights=options.network)
    rows = iter([*spread_rows(len(frames), KEY_FRAMES, ends=3).tolist()] * 2)

    def measured() -> None:
        found = detector.measure(frames, next(rows))
        assert found is not None
        features(found[0], displacement_sigma(found[0]))

    cost("a key frame's measurement and features", measured, KEY_FRAMES)
    cost("a key frame in all", lambda: detector.detect(frames, next(rows)), KEY_FRAMES)


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    tasks = parser.add_subparsers(required=True)
    one = tasks.add_parser("render")
    one.add_argument("folder", type=Path)
    one.add_argument("--scenes", type=int, default=6)
    one.set_defaults(task=render)
    for name, task in (("table", table), ("lessons", clips), ("speed", speed)):
        one = tasks.add_parser(name)
        one.add_argument("network", type=Path)
        one.set_defaults(task=task)
        if name == "table":
            one.add_argument("folder", type=Path)
        if name == "speed":
            one.add_argument("--run", type=Path)
        if name == "lessons":
            one.add_argument("lessons", type=Path, nargs="+")
            one.add_argument("--seeds", type=int, nargs=2, action="append", default=[])
    options = parser.parse_args(arguments)
    cv2.setNumThreads(1)
    options.task(options)


if __name__ == "__main__":
    main()
