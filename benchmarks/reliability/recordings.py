"""Whether the probability that a map states is true: a hundred recordings, with plumes or without.

    python -m benchmarks.stated_probability film  --work work/stated [--flows K...]
    python -m benchmarks.stated_probability judge --work work/stated [--flows K...]
    python -m benchmarks.stated_probability tell  --work work/stated [--plot reliability.png]

Random plants of the seeds 320000 to 320099, which nothing was trained or tuned on, on an arc of 20
to 60 degrees in 24 frames of 320x240 px, 8 of them key frames, noise 0.5 to 3 of 255, poses off by
0.03 degrees and 5 mm. Four in ten are drawn without a plume, the others have one of 0.05 to 1 px. A
plume's flow takes longest to make: plants of seeds 20 apart share one, each with an exit, wind,
strength and views of its own. `film` keeps what stands in the work folder, and so does `judge`:
delete `*.json` there when the method has changed.

A column or plume is true where its axis passes within 15 % of the range of the true one's, at a
height that both have. Without a plume the same is asked of the place where it would have stood.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from benchmarks.reliability.outcomes import NOTHING, Judged, Stated
from benchmarks.reliability.picture import picture
from benchmarks.reliability.report import report
from benchmarks.sensitivity.conditions import Recorded, labels, record
from detect.kinds import REGISTERED
from detect.registered import RegisteredDetector
from detect.registry import DetectorChoice
from detect.synthesis.sample import log_uniform
from geometry.errors import BadInputError
from geometry.trajectory import Trajectory
from locate.fusion.fuse import fuse
from locate.fusion.search.columns import PlumeColumn
from locate.fusion.search.fit import fit_columns
from locate.fusion.search.limit import detection_limit_px
from locate.fusion.search.null import NullLevel
from locate.fusion.search.proposals import MOST_PROPOSALS, propose_columns
from locate.fusion.search.score import column_evidence
from locate.fusion.views import Views
from locate.map.plume import Plume
from locate.pipeline.decide import cap_probability
from locate.simulation import scene as simulated
from locate.simulation.capture import Take
from locate.simulation.layouts import random_scene

SEEDS = range(320_000, 320_100)
FLOWS = 20
PLUME_FREE = 0.4
AMPLITUDE_PX = (0.05, 1.0)
ARC_DEG = (20.0, 60.0)
NOISE = (0.5, 3.0)
FRAMES, KEYS = 24, 8
CAMERA = simulated.CameraBlock(width=320, height=240, focal_px=330)


def scene_of(seed: int) -> simulated.Scene:
    rng = np.random.default_rng([seed, 41])
    scene = random_scene(
        seed,
        plume=bool(rng.random() >= PLUME_FREE),
        amplitude_px=log_uniform(rng, AMPLITUDE_PX),
        noise=log_uniform(rng, NOISE),
        frames=FRAMES,
        arc_deg=float(rng.uniform(*ARC_DEG)),
    )
    plumes = tuple(flowing(plume, flow_of(seed)) for plume in scene.plumes)
    return scene.model_copy(update={"camera": CAMERA, "plumes": plumes})


def flow_of(seed: int) -> int:
    """The seed of the flow that a plume shares with four others at most."""
    return SEEDS.start + seed % FLOWS


def flowing(plume: simulated.PlumeSpec, flow_seed: int) -> simulated.PlumeSpec:
    """The plume with that flow, and with the exit that it comes out of."""
    other = random_scene(flow_seed, plume=True).plumes[0]
    exit_ = {name: getattr(other, name) for name in ("radius_m", "height_m", "temperature_k")}
    return plume.model_copy(update=exit_ | {"flow_seed": flow_seed})


def judge(sequence: Recorded, leak: simulated.PlumeSpec, detector: RegisteredDetector) -> Judged:
    """What a run would state of a recording, and `leak` that stands there or would have stood."""
    units = sequence.inverse_depth_units.tolist()
    detections = [detector.judge(*each) for each in zip(sequence.measurements, units, strict=True)]
    views = Views.from_detections(detections, sequence.trajectory)
    choice = DetectorChoice.parse(detector.name)
    floor_nats = choice.clutter_nats * len(views)
    fused = fuse(views, least_nats=floor_nats)
    null = chance(views)
    lenient = fuse(views, null=null, most_false_alarm=1.0)
    true = Place.of(leak, sequence.trajectory)
    positive, _ = labels(sequence, list(range(len(views))))
    size = np.linalg.norm(sequence.truth, axis=-1)[positive]
    return Judged(
        amplitude_px=max((p.amplitude_px or 0.0 for p in sequence.scene.plumes), default=0.0),
        strength_px=float(size.mean()) if size.size else 0.0,
        noise=sequence.scene.image.noise,
        views=len(views),
        floor_nats=floor_nats,
        threshold_nats=fused.threshold_nats,
        limit_px=detection_limit_px(views, fused.threshold_nats, response=detector.response),
        strongest=strongest(views, null, true),
        unasked=next((true.stated(plume) for plume in lenient.plumes), NOTHING),
        plumes=tuple(
            true.stated(cap_probability(plume, choice, len(views))) for plume in fused.plumes
        ),
    )


def chance(views: Views) -> NullLevel:
    """The null that `fuse` draws of these views."""
    rng = np.random.default_rng(0)
    return NullLevel.from_views(views, views.volume(), rng, progress=lambda _: None)


@dataclass(frozen=True, kw_only=True)
class Place:
    """Where a plume stands: an upright column of fusion, and its distance from the cameras."""

    column: PlumeColumn
    range_m: float

    @classmethod
    def of(cls, leak: simulated.PlumeSpec, trajectory: Trajectory) -> "Place":
        column = PlumeColumn(np.array([*leak.source, 0, 0, leak.height_m, leak.radius_m, 0]))
        away = np.linalg.norm(trajectory.centers_in_world - np.array(leak.source), axis=1)
        return cls(column=column, range_m=float(away.mean()))

    def off(self, column: PlumeColumn) -> float:
        return column.gap_to(self.column) / self.range_m

    def stated(self, plume: Plume) -> Stated:
        off = self.off(axis_of(plume))
        return Stated(nats=plume.evidence_nats, probability=plume.probability, off=off)


def strongest(views: Views, null: NullLevel, true: Place) -> Stated:
    """The strongest column, searched for as in the draws of chance."""
    rng = np.random.default_rng(0)
    starts = propose_columns(views, views.volume(), most=MOST_PROPOSALS)[0].columns
    columns = fit_columns(partial(column_evidence, views), starts, views.unit, rng)
    if not len(columns):
        return NOTHING
    nats = float(column_evidence(views, columns[0].alone)[0])
    return Stated(nats=nats, probability=1 - null.false_alarm(nats), off=true.off(columns[0]))


def axis_of(plume: Plume) -> PlumeColumn:
    """A plume of the map as a column of fusion; of its width nothing is asked."""
    slopes = plume.axis[:2] / plume.axis[2]
    height = plume.extent_high * plume.axis[2]
    return PlumeColumn(np.array([*plume.source, *slopes, height, 0, 0]))


def film_all(options: argparse.Namespace) -> None:
    for seed in chosen(options):
        path = options.work / f"{seed}.npz"
        if not path.exists():
            record(Take(scene=scene_of(seed)), KEYS, path)
            print(seed, flush=True)


def judge_all(options: argparse.Namespace) -> None:
    detector = RegisteredDetector(weights=REGISTERED.find_weights())
    for seed in chosen(options):
        recorded, path = (options.work / f"{seed}.{suffix}" for suffix in ("npz", "json"))
        if recorded.exists() and not path.exists():
            leak = flowing(random_scene(seed, plume=True).plumes[0], flow_of(seed))
            judge(Recorded.load(recorded, Take(scene=scene_of(seed))), leak, detector).save(path)
            print(seed, path.read_text(), flush=True)


def chosen(options: argparse.Namespace) -> list[int]:
    """The seeds of the flows asked for, those of one flow together."""
    flows = [SEEDS.start + k for k in options.flows]
    return [seed for seed in sorted(SEEDS, key=flow_of) if flow_of(seed) in flows]


def tell(options: argparse.Namespace) -> None:
    paths = [options.work / f"{seed}.json" for seed in chosen(options)]
    every = [Judged.load(path) for path in paths if path.exists()]
    if not every:
        raise BadInputError(f"{options.work}: nothing judged there yet; run film and judge first")
    print(report(every))
    if options.plot:
        cv2.imwrite(str(options.plot), picture(every))


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("task", choices=("film", "judge", "tell"))
    parser.add_argument("--work", type=Path, default=Path("work/stated"))
    flows = range(FLOWS)
    parser.add_argument("--flows", type=int, nargs="+", choices=flows, default=flows, metavar="K")
    parser.add_argument("--plot", type=Path)
    options = parser.parse_args(arguments)
    cv2.setNumThreads(1)
    options.work.mkdir(parents=True, exist_ok=True)
    try:
        {"film": film_all, "judge": judge_all, "tell": tell}[options.task](options)
    except BadInputError as error:
        parser.error(str(error))


if __name__ == "__main__":
    main()
