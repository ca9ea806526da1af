"""What a network over registered neighbours adds to the scores made by hand.

    OMP_NUM_THREADS=1 python benchmarks/registered_learned.py render FOLDER [--scenes 6]
    ... table NETWORK.onnx FOLDER
    ... lessons NETWORK.onnx LESSONS... [--seeds FIRST END]...
    ... speed NETWORK.onnx [--run RUN]

`render` makes test lessons of 320 x 240 px, a folder for each strength and noise: layouts of the
same generator as the training's, of seeds that nothing was trained, chosen or calibrated on
(300000 and on), poses off by up to 0.1 degrees. A pixel is positive where |w| exceeds 0.3 of the
plume's amplitude, negative where it is below 0.01 px, neither in between; sky and everything that
is not measured counts as neither. `plain` is `registered-plain`. EPE is the mean error over
positives, beside that of an answer of zero. The reliability says what a stated llr is worth: the
log of the share of positives over the share of negatives whose llr lies there.
"""

import argparse
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
from detection_limit import recorded

from detect.evidence import LLR_MAX, LLR_MIN, displacement_evidence
from detect.registered.calibrate import Read, chosen, read_lesson
from detect.registered.detector import RegisteredDetector, displacement_sigma
from detect.registered.detector import trust as trust_in
from detect.registered.features import FEATURES, SMALL_PX, feature, features
from detect.registered.learned import CLASS_NAMES, Reader
from detect.registered.lessons import KINDS, Lesson, lesson_path, lesson_paths
from detect.scores import auroc, average_precision
from geometry.arrays import FloatMap
from locate.observe import load_points, spread

FIRST_SEED = 300_000
CONDITIONS = ((1.0, 1.0), (0.3, 1.0), (0.3, 3.0), (0.1, 1.0), (0.0, 1.0), (0.0, 3.0))
THIN = (slice(1, None, 4),) * 2
BINS = np.array([LLR_MIN, -1, -0.5, 0.5, 1, 1.5, 2, 2.5, 3, 3.5, LLR_MAX])
FEWEST = 50
KEY_FRAMES = 16


def name_of(amplitude_px: float, noise: float) -> str:
    return f"{amplitude_px:.1f}px_noise{noise:.0f}"


def render(options: argparse.Namespace) -> None:
    from locate.simulation.filming import Take, film
    from locate.simulation.lessons import lesson_scene, measured

    for seed in range(FIRST_SEED, FIRST_SEED + options.scenes):
        for amplitude_px, noise in CONDITIONS:
            path = lesson_path(options.folder / name_of(amplitude_px, noise), seed)
            if path.exists():
                continue
            path.parent.mkdir(parents=True, exist_ok=True)
            scene = lesson_scene(seed, plume=amplitude_px > 0)
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

    def add(self, lesson: Lesson) -> None:
        for read in read_lesson(self._reader, lesson):
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


def reliability(llr: np.ndarray, positive: np.ndarray) -> list[str]:
    """Observed at stated, of each of `BINS`; the bounds are bins of their own."""
    cells = []
    edges = [-np.inf, *(BINS[:-1] + 1e-3), LLR_MAX - 1e-3, np.inf]
    for low, high in pairwise(edges):
        members = (llr > low) & (llr <= high) & (llr != 0)
        hits, misses = (members & positive).sum(), (members & ~positive).sum()
        if min(hits, misses) < FEWEST:
            cells.append("")
            continue
        observed = np.log(hits / positive.sum()) - np.log(misses / (~positive).sum())
        cells.append(f"{observed:.1f} at {llr[members].mean():.1f}")
    return cells


def table(options: argparse.Namespace) -> None:
    reader = Reader(options.network)
    print("| amplitude, noise | contender | AUROC | AP | EPE / of zero, px | llr > 1 in plumes "
          "| outside |\n|" + "---|" * 7)  # fmt: skip
    tallies = {}
    for amplitude_px, noise in CONDITIONS:
        tally = Tally(reader)
        for path in lesson_paths(options.folder / name_of(amplitude_px, noise)):
            tally.add(Lesson.load(path))
        tallies[f"{amplitude_px:.1f} px, {noise:.0f}/255"] = tally
        for row in tally.rows():
            print(f"| {amplitude_px:.1f} px, {noise:.0f}/255 | {row} |", flush=True)
    print_reliability(tallies)


def lessons(options: argparse.Namespace) -> None:
    reader = Reader(options.network)
    tallies: defaultdict[str, Tally] = defaultdict(lambda: Tally(reader))
    for path in chosen(options.lessons, options.seeds):
        lesson = Lesson.load(path)
        tallies[KINDS[lesson.kind]].add(lesson)
    print("| strength | contender | AUROC | AP | EPE / of zero, px | llr > 1 in plumes "
          "| outside |\n|" + "---|" * 7)  # fmt: skip
    for kind in sorted(tallies, key=KINDS.index):
        for row in tallies[kind].rows():
            print(f"| {kind} | {row} |", flush=True)
    print_reliability(tallies)


def print_reliability(tallies: dict[str, Tally]) -> None:
    columns = {
        name: np.concatenate([tally[name] for tally in tallies.values()])
        for name in ("learned", "positive", "place")
    }
    print("\n| reliability | " + " | ".join(f"to {high:g}" for high in [*BINS, np.inf]) + " |")
    print("|" + "---|" * (len(BINS) + 2))
    rows = {"all": columns["positive"] | True}
    rows |= {name: columns["place"] == k for k, name in enumerate(CLASS_NAMES)}
    for name, members in rows.items():
        cells = reliability(columns["learned"][members], columns["positive"][members])
        print(f"| {name}, {members.mean():.2f} of pixels | " + " | ".join(cells) + " |")
    for name, tally in tallies.items():
        if tally["positive"].any():
            cells = reliability(tally["learned"], tally["positive"])
            print(f"| {name} | " + " | ".join(cells) + " |")
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
    rows = iter([*spread(len(frames), KEY_FRAMES, ends=3).tolist()] * 2)

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
    for name, task in (("table", table), ("lessons", lessons), ("speed", speed)):
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
