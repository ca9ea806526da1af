"""The paper's comparison of flow methods, with truth: simulated pairs before printed backgrounds.

    OMP_NUM_THREADS=1 python -m benchmarks.flow simulated [--flows DIR] [--onnx NET.onnx ...]

A reference (mean of 50 frames) and a frame with a plume, both formed as a camera forms them; the
camera vibrates by up to 0.2 px in each direction, and the median bias is removed. Plume: |w| above
a third of the peak; still: below a thirtieth. Found: AUROC of |flow|, plume against still, is above
0.9 at this peak and at every larger one.

A second table shows what a fault of the recording costs Horn-Schunck: mean length of the flow where
there is no plume at all, before the first eight random backgrounds of each kind.
"""

import argparse
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from detect.bos import texture_of, unbiased_flow
from detect.flow import METHODS, Flow, flow_method
from detect.scores import auroc
from detect.synthesis.camera import MARGIN_PX, Background, CameraOptics, expose_background
from detect.synthesis.flows import random_turbulence, read_run, runs_in
from detect.synthesis.placement import PlumePlacement
from detect.synthesis.raster import as_background, canvas_side, draw_perlin, draw_squares
from geometry.arrays import FloatMap, GreyImage

KINDS = ("sinusoid", "perlin", "squares")
LIGHT_CHANGES = (0.005, 0.01, 0.02, 0.05)
TURNS_PX = (0.05, 0.1, 0.2)
SIZE_PX = 256
PERIOD_PX = 8.0
PEAKS_PX = (0.05, 0.1, 0.2, 0.4, 0.8)
VIBRATION_PX = 0.2
REFERENCE_FRAMES = 50
FOUND = 0.9
TIMED_SHAPE = (480, 640)


@dataclass(frozen=True, kw_only=True)
class Pair:
    reference: GreyImage
    image: GreyImage
    truth: FloatMap
    peak_px: float


def sinusoid(x: FloatMap, y: FloatMap) -> FloatMap:
    """The paper's background: 8 px in both directions."""
    k = np.float32(2 * np.pi / PERIOD_PX)
    return np.asarray(0.45 + 0.2 * (np.sin(k * x) + np.sin(k * y)), np.float32)


def background(kind: str, rng: np.random.Generator) -> Background:
    if kind == "sinusoid":
        return sinusoid
    picture = {"perlin": draw_perlin, "squares": draw_squares}[kind]
    return as_background(picture(rng, canvas_side(SIZE_PX)))


def expose_pair(
    scene: Background, w: FloatMap, noise: float, rng: np.random.Generator
) -> tuple[GreyImage, GreyImage]:
    """The reference and the frame."""
    still = np.zeros_like(w)
    reference = CameraOptics(noise=noise / np.sqrt(REFERENCE_FRAMES))
    shake = rng.uniform(-VIBRATION_PX, VIBRATION_PX, 2)
    return (
        expose_background(scene, [still], np.zeros(2), reference, rng),
        expose_background(scene, [w], shake, CameraOptics(noise=noise), rng),
    )


def simulate_pairs(
    kind: str, count: int, noise: float, runs: Sequence[Path], seed: int
) -> Iterator[Pair]:
    inside = slice(MARGIN_PX, -MARGIN_PX)
    for peak_px in PEAKS_PX:
        rng = np.random.default_rng(seed)  # the same plumes at every peak
        for _ in range(count):
            if runs:
                moments = read_run(runs[int(rng.integers(len(runs)))])
                potential = moments[rng.integers(len(moments))]
            else:
                potential = random_turbulence(rng)
            place = PlumePlacement.draw_uniform(
                rng, potential, size_px=SIZE_PX, relative_length=1.0, visible=0.3
            )
            w = np.float32(peak_px) * place.displacement(
                potential, size_px=SIZE_PX, margin_px=MARGIN_PX, drift_px=np.zeros(2)
            )
            reference, image = expose_pair(background(kind, rng), w, noise, rng)
            yield Pair(reference=reference, image=image, truth=w[inside, inside], peak_px=peak_px)


@dataclass(frozen=True, kw_only=True)
class FlowScore:
    """How well a method did on pairs of one background.

    Attributes:
        epe_px: Mean end-point error in the plumes.
        zero_px: The same of no displacement at all.
        gain: Slope of the measured against the true displacement.
        noise_px: Root mean square of the flow where the air is still.
        areas: AUROC of |flow| at each of `PEAKS_PX`.
    """

    epe_px: float
    zero_px: float
    gain: float
    noise_px: float
    areas: tuple[float, ...]

    @property
    def found_from(self) -> str:
        """The smallest peak from which every AUROC is above `FOUND`, px."""
        return smallest_found(self.areas)


def score_flow(flow: Flow, simulated: Sequence[Pair]) -> FlowScore:
    errors, zeros, projections, squares_, noise = [], [], [], [], []
    scores: dict[float, list[tuple[np.ndarray, np.ndarray]]] = {peak: [] for peak in PEAKS_PX}
    for pair in simulated:
        found, _ = unbiased_flow(flow, pair.reference, pair.image, texture_of(pair.reference))
        size, true_size = (np.linalg.norm(w, axis=-1) for w in (found, pair.truth))
        plume, still = true_size > pair.peak_px / 3, true_size < pair.peak_px / 30
        errors.append(np.linalg.norm(found - pair.truth, axis=-1)[plume])
        zeros.append(true_size[plume])
        projections.append((found * pair.truth)[plume].sum())
        squares_.append((pair.truth**2)[plume].sum())
        noise.append((size[still] ** 2).mean())
        judged = plume | still
        scores[pair.peak_px].append((size[judged], plume[judged]))
    return FlowScore(
        epe_px=float(np.concatenate(errors).mean()),
        zero_px=float(np.concatenate(zeros).mean()),
        gain=float(sum(projections) / sum(squares_)),
        noise_px=float(np.sqrt(np.mean(noise))),
        areas=tuple(
            auroc(*(np.concatenate(part) for part in zip(*scores[peak], strict=True)))
            for peak in PEAKS_PX
        ),
    )


def score_row(score: FlowScore) -> str:
    areas = " / ".join(f"{area:.2f}".lstrip("0") for area in score.areas)
    return (
        f"{score.epe_px:.3f} / {score.zero_px:.3f} | {score.gain:.2f} | {score.noise_px:.3f} | "
        f"{areas} | {score.found_from}"
    )


def smallest_found(areas: Sequence[float]) -> str:
    answer = "none"
    for peak, area in zip(reversed(PEAKS_PX), reversed(areas), strict=True):
        if area <= FOUND:
            break
        answer = f"{peak:g}"
    return answer


def cpu_milliseconds(flow: Flow) -> float:
    """CPU time for a pair of 640 x 480, one thread."""
    rng = np.random.default_rng(0)
    w = np.zeros((TIMED_SHAPE[0] + 2 * MARGIN_PX, TIMED_SHAPE[1] + 2 * MARGIN_PX, 2), np.float32)
    reference, image = expose_pair(sinusoid, w, 1.0, rng)
    flow(reference, image)
    start = time.process_time()
    for _ in range(3):
        flow(reference, image)
    return (time.process_time() - start) / 3 * 1000


def false_flow(kind: str, *, light: float, turn_px: float, count: int, noise: float) -> float:
    """Mean false flow, px, of light changed by a factor and of a turn, px at the frame's edge."""
    rng, flow = np.random.default_rng(0), flow_method("horn-schunck")
    side = SIZE_PX + 2 * MARGIN_PX
    y, x = (np.mgrid[:side, :side].astype(np.float32) - side / 2) * (2 * turn_px / SIZE_PX)
    false = []
    for _ in range(count):
        turned = np.stack([-y, x], axis=-1).astype(np.float32)
        reference, image = expose_pair(background(kind, rng), turned, noise, rng)
        lit = np.rint(light * image).clip(0, 255).astype(np.uint8)
        found, _ = unbiased_flow(flow, reference, lit, texture_of(reference))
        false.append(np.linalg.norm(found, axis=-1).mean())
    return float(np.mean(false))


def print_costs(count: int, noise: float) -> None:
    print("\n| false flow, px | sinusoid | perlin | squares |\n|---|---|---|---|")
    faults = [("none", 1.0, 0.0)]
    faults += [(f"light up {100 * change:g} %", 1 + change, 0.0) for change in LIGHT_CHANGES]
    faults += [(f"camera turned, {turn:g} px at the edge", 1.0, turn) for turn in TURNS_PX]
    for name, light, turn_px in faults:
        costs = [
            false_flow(kind, light=light, turn_px=turn_px, count=count, noise=noise)
            for kind in KINDS
        ]
        print(f"| {name} | {' | '.join(f'{cost:.3f}' for cost in costs)} |", flush=True)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--flows", type=Path, help="simulated runs; without, random turbulence")
    parser.add_argument("--onnx", type=Path, nargs="*", default=[], help="flow networks")
    parser.add_argument("--pairs", type=int, default=8, help="per background and peak")
    parser.add_argument("--noise", type=float, default=1.0, help="grey levels of 255")
    parser.add_argument("--seed", type=int, default=0)


def main(options: argparse.Namespace) -> None:
    runs = runs_in(options.flows, "test") if options.flows else ()
    simulated = {
        kind: list(simulate_pairs(kind, options.pairs, options.noise, runs, options.seed))
        for kind in KINDS
    }
    peaks = " / ".join(f"{peak:g}" for peak in PEAKS_PX)
    print(f"noise {options.noise:g} of 255, {options.pairs} pairs of {SIZE_PX} px for each peak\n")
    print("| flow | background | EPE in the plume / of zero, px | gain | noise, px | "
          f"AUROC at {peaks} px | found from, px | ms |")  # fmt: skip
    print("|---|---|---|---|---|---|---|---|")
    for name in [*METHODS, *map(str, options.onnx)]:
        flow = flow_method(name)
        spent = cpu_milliseconds(flow)
        for kind, group in simulated.items():
            row = score_row(score_flow(flow, group))
            print(f"| {Path(name).name} | {kind} | {row} | {spent:.0f} |", flush=True)
    print_costs(options.pairs, options.noise)
