"""The three experiments of the DYBS paper's section IV, with truth beside them.

    OMP_NUM_THREADS=1 python benchmarks/paper_experiments.py unseen --samples TEST [--every 1]
    ... deflected
    ... moving
        [--network NET.onnx] [--picture FIGURE.jpg]

`unseen` (experiment 1): flows and backgrounds that nothing was trained on.
`deflected` (experiment 2): a camera at rest before a sinusoid of 8 px, plumes deflected by wind and
by a plate; the single frame beside Horn-Schunck against the mean of 50 frames. The plate stands in
the reference, or was moved since by 3 px along each axis, or came in later.
`moving` (experiment 3): a camera in the hand walks past a wall of vertical waves, of a grid of
squares, which no training sample shows, and round a plant of brick, concrete and gravel; once with
an exposure of 20 ms, otherwise without motion blur.

Columns: magnitude error, the mean of ||answer| - |w||, beside the mean |w| (the paper's measure);
EPE over |w| > 0.06 px beside that of an answer of zero; r of both components there; AUROC of the
score, |w| > 0.06 px against |w| < 0.02 px; precision and recall of llr > 2; speaks: share of pixels
with any evidence. Pixels of objects in front of the background count in none of them; `beside
objects` is the mean and the 99th percentile of the error within 16 px of one, px.
"""

import argparse
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import cv2
import numpy as np

from detect.bos import BosDetector
from detect.detection import Detection, Frames
from detect.dybs import DybsDetector
from detect.kinds import DYBS
from detect.scores import auroc
from detect.synthesis import FAMILIES, shards_in
from detect.synthesis.buoyancy import BuoyantFlow
from detect.synthesis.camera import MARGIN_PX, OVERSAMPLING, Background, Optics, expose
from detect.synthesis.flows import CELL_M, CELLS, Source, slopes
from geometry.arrays import BoolArray, FloatArray, FloatMap, GreyImage
from locate.export.pictures import displacement_picture
from locate.simulation.camera_paths import fly
from locate.simulation.layouts import random_scene
from locate.simulation.plume_field import PlumeField
from locate.simulation.render import Renderer
from locate.simulation.scene import (
    BoxObject,
    GroundObject,
    ImageBlock,
    PathBlock,
    PlumeSpec,
    Scene,
    VideoBlock,
    WallObject,
)
from locate.simulation.shutter import INSTANT, Shutter
from locate.simulation.surfaces import World

PLUME_PX, STILL_PX, MASK_NATS = 0.06, 0.02, 2.0
BESIDE_PX = 16
RANKS = (0.7, 0.9)
SIZE_PX, CELL_PX, BASE_PX = 480, 6.0, 36
PERIOD_PX = 8.0
PEAK_PX, NOISE, REFERENCE_FRAMES, VIBRATION_PX = 0.6, 1.0, 50, 0.2
MOMENTS, INTERVAL_S = 6, 0.3
VIEWS, EXPOSURE_S = 3, 0.02
PLATE_CELLS, PLATE_TONE, MOVED_PX = (20.0, 38.0, 30.0), 0.25, 3.0
"""Left end, right end and height of the plate; 3 cells thick, 24 deep."""
HEADER = ("| {what} | frames | magnitude error at mean, px | EPE / of zero, px | r | AUROC | "
          "precision | recall | speaks | beside objects, px |\n" + "|---" * 10 + "|")  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Seen:
    """One frame, what is true of it, and what one method says; (H, W) each."""

    image: GreyImage
    truth: FloatMap
    answer: Detection
    counts: BoolArray
    beside: BoolArray


def row(frames: Sequence[Seen]) -> str:
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
        f"{plume[judged].mean():.2f}" if judged.any() else "silent",
        f"{mask[plume].mean():.2f}",
        f"{(llr != 0)[counts].mean():.2f}",
    ]
    near = error[beside & counts]
    cells.append(f"{near.mean():.3f}, {np.percentile(near, 99):.2f}" if near.size else "")
    return f"{len(frames)} | " + " | ".join(cells)


def unseen(detector: DybsDetector, options: argparse.Namespace) -> list[np.ndarray]:
    """Samples of the test split with a plume, by background."""
    groups: dict[str, list[Seen]] = {}
    for shard in shards_in(options.samples):
        for i in range(0, len(shard), options.every):
            sample = shard.sample(i)
            if not sample.displacement.any():
                continue
            everywhere = np.ones(sample.image.shape, dtype=bool)
            seen = Seen(
                image=sample.image,
                truth=sample.displacement,
                answer=detector.detect(Frames(images=[sample.image]), 0),
                counts=everywhere,
                beside=~everywhere,
            )
            groups.setdefault(sample.family, []).append(seen)
    print(HEADER.format(what="background"))
    for family in FAMILIES:
        print(f"| {family} | {row(groups[family])} |", flush=True)
    return [
        np.hstack([
            strip(seen.image, seen.truth, seen.answer.displacement, side=180)
            for seen in ranked(groups[family], RANKS)
        ])
        for family in ("sinusoid", "checkerboard", "photo")
    ]  # fmt: skip


def ranked(group: Sequence[Seen], shares: Sequence[float]) -> list[Seen]:
    """Frames by the rank of their mean displacement, 0 the weakest, 1 the strongest."""
    ordered = sorted(group, key=lambda seen: float(np.abs(seen.truth).mean()))
    return [ordered[round(share * (len(ordered) - 1))] for share in shares]


@dataclass(frozen=True, kw_only=True)
class Setup:
    """What deflects a plume, and where the plate stood when the reference was taken."""

    name: str
    wind_mps: float = 0.0
    plate: bool = False
    reference_shift_px: float | None = 0.0


SETUPS = (
    Setup(name="undisturbed"),
    Setup(name="wind", wind_mps=0.3),
    Setup(name="plate, at rest", plate=True),
    Setup(name="plate, moved by 4 px", plate=True, reference_shift_px=MOVED_PX),
    Setup(name="plate, brought in", plate=True, reference_shift_px=None),
)


@cache
def flow_moments(wind_mps: float, plate: bool) -> list[FloatMap]:
    """(SIZE, SIZE, 2) with margins: the displacement at each moment, its 99.9th percentile PEAK."""
    solid = np.zeros(CELLS, dtype=bool)
    if plate:
        left, right, height = PLATE_CELLS
        x, y, z = np.indices(CELLS)
        solid = (x >= left) & (x < right) & (abs(y - CELLS[1] / 2) < 12) & (abs(z - height) < 1.5)
    rng = np.random.default_rng(2)
    source = Source(gas="air", mole_fraction=1.0, temperature_k=440.0)
    flow = BuoyantFlow(
        CELLS,
        cell_m=CELL_M,
        radius_m=0.1,
        deficit=0.33,
        exit_mps=0.3,
        rng=rng,
        wind_mps=wind_mps,
        solid=solid,
    )
    flow.develop()
    fields = []
    for _ in range(MOMENTS):
        flow.advance(INTERVAL_S)
        excess = source.excess_refractivity(np.clip(flow.tracer, 0, 1)).sum(axis=1)
        fields.append(in_frame(excess))
    peak = np.percentile([np.linalg.norm(w, axis=-1) for w in fields], 99.9)
    return [np.asarray(w * np.float32(PEAK_PX / peak)) for w in fields]


def in_frame(excess: FloatMap) -> FloatMap:
    """The gradient of an integral over (across, up), in a frame that stands on the heat source."""
    y, x = np.mgrid[
        -MARGIN_PX - 1 : SIZE_PX + MARGIN_PX + 1, -MARGIN_PX - 1 : SIZE_PX + MARGIN_PX + 1
    ]
    up = (SIZE_PX - BASE_PX - y) / CELL_PX
    across = (x - SIZE_PX / 2) / CELL_PX + (CELLS[0] - 1) / 2
    soft = cv2.GaussianBlur(excess.T, (0, 0), 0.8)
    potential = cv2.remap(
        soft, across.astype(np.float32), up.astype(np.float32), cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )  # fmt: skip
    potential = cv2.GaussianBlur(potential, (0, 0), CELL_PX)
    return slopes(potential)[1:-1, 1:-1]


def lattice(x: FloatMap, y: FloatMap) -> FloatMap:
    """The paper's background: waves of 8 px in both directions."""
    k = np.float32(2 * np.pi / PERIOD_PX)
    return np.float32(0.45) + np.float32(0.2) * (np.sin(k * x) + np.sin(k * y))


Covered = Callable[[FloatArray, FloatArray], BoolArray]


def objects(setup: Setup, shift_px: float | None) -> Covered:
    """Whether the heat source, the plate or its rod covers a place of the frame."""

    def covered(x: FloatArray, y: FloatArray) -> BoolArray:
        source = (np.abs(x - SIZE_PX / 2) < 70) & (y > SIZE_PX - BASE_PX)
        if not setup.plate or shift_px is None:
            return source
        left, right, height = PLATE_CELLS
        across = (x - shift_px - SIZE_PX / 2) / CELL_PX + CELLS[0] / 2
        up = (SIZE_PX - BASE_PX - y + shift_px) / CELL_PX - height
        plate = (across >= left) & (across < right) & (np.abs(up) < 1.5)
        rod = (across >= right) & (np.abs(up) < 0.5)
        return source | plate | rod

    return covered


def with_objects(covered: Covered, shake_px: FloatArray) -> Background:
    """The lattice, and in front of it what the plume does not displace."""

    def radiance(x: FloatMap, y: FloatMap) -> FloatMap:
        down, across = (
            (np.arange(n) + 0.5) / OVERSAMPLING - 0.5 - MARGIN_PX + shake
            for n, shake in zip(x.shape, shake_px[::-1], strict=True)
        )
        in_front = covered(across[None], down[:, None])
        return np.where(in_front, np.float32(PLATE_TONE), lattice(x, y))

    return radiance


def filmed(setup: Setup) -> Iterator[tuple[GreyImage, GreyImage, FloatMap, BoolArray]]:
    """Reference, frame, truth, and what objects cover in either."""
    rng = np.random.default_rng(5)
    grid = np.meshgrid(np.arange(SIZE_PX), np.arange(SIZE_PX))
    then, now = objects(setup, setup.reference_shift_px), objects(setup, 0.0)
    still = np.zeros((SIZE_PX + 2 * MARGIN_PX,) * 2 + (2,), np.float32)
    optics = Optics(noise=NOISE / REFERENCE_FRAMES**0.5)
    reference = expose(with_objects(then, np.zeros(2)), [still], np.zeros(2), optics, rng)
    for w in flow_moments(setup.wind_mps, setup.plate):
        shake = rng.uniform(-VIBRATION_PX, VIBRATION_PX, 2)
        image = expose(with_objects(now, shake), [w], shake, Optics(noise=NOISE), rng)
        inside = slice(MARGIN_PX, -MARGIN_PX)
        yield reference, image, w[inside, inside], now(*grid) | then(*grid)


def deflected(detector: DybsDetector, _: argparse.Namespace) -> list[np.ndarray]:
    print(HEADER.format(what="flow | method").replace("|---", "|---|---", 1))
    strips = []
    for setup in SETUPS:
        told: dict[str, list[Seen]] = {"two frames": [], "dybs": []}
        for reference, image, truth, covered in filmed(setup):
            frames = Frames(images=[image])
            held = covered.astype(np.uint8)
            held[SIZE_PX - BASE_PX :] = 0
            near = cv2.dilate(held, np.ones((2 * BESIDE_PX + 1,) * 2)) > 0
            for name, method in (
                ("two frames", BosDetector(reference=reference)),
                ("dybs", detector),
            ):
                answer = method.detect(frames, 0)
                told[name].append(
                    Seen(image=image, truth=truth, answer=answer, counts=~covered, beside=near)
                )
        for name, frames_seen in told.items():
            print(f"| {setup.name} | {name} | {row(frames_seen)} |", flush=True)
        last = {name: seen[-1] for name, seen in told.items()}
        answers = [last[name].answer.displacement for name in ("dybs", "two frames")]
        strips.append(strip(last["dybs"].image, last["dybs"].truth, *answers, side=240))
    return strips


def wall_scene(material: str, amplitude_px: float, *, start_deg: float = -100) -> Scene:
    """A printed wall behind a heat source on a box, the camera walking round them."""
    return Scene(
        seed=31,
        video=VideoBlock(frames=VIEWS, fps=1.5),
        image=ImageBlock(noise=NOISE),
        path=PathBlock(
            kind="handheld", target=(0, 0, 1.7), radius_m=3.4, height_m=1.5, start_deg=start_deg,
            arc_deg=20, jitter_m=0.03, jitter_deg=1.0,
        ),
        objects=(
            GroundObject(kind="ground", material="concrete"),
            WallObject(kind="wall", start=(-8, 1.5), end=(8, 1.5), height_m=6, material=material),
            BoxObject(kind="box", center=(0, 0, 0.35), size=(0.6, 0.6, 0.7), material="steel"),
        ),
        plumes=(PlumeSpec(source=(0, 0, 0.7), height_m=2.6, amplitude_px=amplitude_px),),
    )  # fmt: skip


def scenes() -> dict[str, tuple[Scene, Shutter]]:
    plant = random_scene(5_000_031, plume=True, amplitude_px=0.6, noise=NOISE, frames=VIEWS)
    return {
        "waves, 0.6 px": (wall_scene("waves", 0.6), INSTANT),
        "waves, 0.6 px, aslant": (wall_scene("waves", 0.6, start_deg=-140), INSTANT),
        "waves, 0.6 px, motion blur": (wall_scene("waves", 0.6), Shutter(exposure_s=EXPOSURE_S)),
        "waves, 0.15 px": (wall_scene("waves", 0.15), INSTANT),
        "grid of squares, 0.6 px": (wall_scene("grid", 0.6), INSTANT),
        "plant, 0.6 px": (plant, INSTANT),
    }


def rendered(scene: Scene, shutter: Shutter) -> Iterator[tuple[GreyImage, FloatMap]]:
    trajectory = fly(scene)
    fields = [PlumeField(scene, number) for number in range(len(scene.plumes))]
    renderer = Renderer(scene, World(scene), fields, trajectory, shutter)
    for i in range(len(trajectory)):
        image, truth = renderer.render(i)
        yield image, truth.displacement


def moving(detector: DybsDetector, _: argparse.Namespace) -> list[np.ndarray]:
    print(HEADER.format(what="scene"))
    strips = []
    for name, (scene, shutter) in scenes().items():
        seen = []
        for image, truth in rendered(scene, shutter):
            everywhere = np.ones(image.shape, dtype=bool)
            answer = detector.detect(Frames(images=[image]), 0)
            seen.append(
                Seen(image=image, truth=truth, answer=answer, counts=everywhere, beside=~everywhere)
            )
        print(f"| {name} | {row(seen)} |", flush=True)
        strips.append(strip(seen[1].image, seen[1].truth, seen[1].answer.displacement, side=200))
    return strips


def strip(image: GreyImage, *fields: FloatMap, side: int) -> np.ndarray:
    """The image and displacements beside each other; all share the scale of the first field."""
    scale = float(np.linalg.norm(fields[0], axis=-1).max())
    panels = [cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)]
    panels += [displacement_picture(field, full_scale_px=scale) for field in fields]
    width = round(side * image.shape[1] / image.shape[0])
    small = [cv2.resize(panel, (width, side), interpolation=cv2.INTER_AREA) for panel in panels]
    white = np.full((side, 4, 3), 255, np.uint8)
    return np.hstack([part for panel in small for part in (panel, white)])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    tasks = {"unseen": unseen, "deflected": deflected, "moving": moving}
    parser.add_argument("task", choices=tasks)
    parser.add_argument("--network", type=Path, default=DYBS.installed_weights)
    parser.add_argument("--samples", type=Path)
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--picture", type=Path)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    strips = tasks[options.task](DybsDetector(options.network), options)
    if options.picture:
        gaps = [np.full((4, *strips[0].shape[1:]), 255, np.uint8)] * len(strips)
        cv2.imwrite(
            str(options.picture),
            np.vstack([p for pair in zip(strips, gaps, strict=True) for p in pair]),
        )


if __name__ == "__main__":
    main()
