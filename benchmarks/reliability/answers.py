"""What a run would state of a recording, held against the truth."""

from dataclasses import dataclass
from functools import partial

import numpy as np

from benchmarks.common.filmed import Recorded, labels
from benchmarks.reliability.outcomes import NO_COLUMN, RecordingOutcome, Stated
from detect.registered import RegisteredDetector
from detect.registry import DetectorChoice
from geometry.trajectory import Trajectory
from locate.fusion.fuse import fuse
from locate.fusion.limit import detection_limit_px
from locate.fusion.search.columns import PlumeColumn
from locate.fusion.search.fit import fit_columns
from locate.fusion.search.null import NullLevel
from locate.fusion.search.proposals import MOST_PROPOSALS, propose_columns
from locate.fusion.search.score import column_evidence
from locate.fusion.views import Views
from locate.map.plume import Plume
from locate.pipeline.decide import cap_probability
from locate.simulation import scene as simulated


def evaluate_recording(
    sequence: Recorded, leak: simulated.PlumeSpec, detector: RegisteredDetector
) -> RecordingOutcome:
    """What a run would state of a recording, and `leak` that stands there or would have stood."""
    units = sequence.inverse_depth_units.tolist()
    detections = [
        detector.to_detection(*each) for each in zip(sequence.measurements, units, strict=True)
    ]
    views = Views.from_detections(detections, sequence.trajectory)
    choice = DetectorChoice.parse(detector.name)
    floor_nats = choice.clutter_nats * len(views)
    fused = fuse(views, least_nats=floor_nats)
    null = draw_null(views)
    lenient = fuse(views, null=null, most_false_alarm=1.0)
    true = TruePlume.of(leak, sequence.trajectory)
    positive, _ = labels(sequence, list(range(len(views))))
    size = np.linalg.norm(sequence.truth, axis=-1)[positive]
    return RecordingOutcome(
        amplitude_px=max((p.amplitude_px or 0.0 for p in sequence.scene.plumes), default=0.0),
        strength_px=float(size.mean()) if size.size else 0.0,
        noise=sequence.scene.image.noise,
        views=len(views),
        floor_nats=floor_nats,
        threshold_nats=fused.threshold_nats,
        limit_px=detection_limit_px(views, fused.threshold_nats, response=detector.response),
        strongest=strongest_column(views, null, true),
        unasked=next((true.stated(plume) for plume in lenient.plumes), NO_COLUMN),
        plumes=tuple(
            true.stated(cap_probability(plume, choice, len(views))) for plume in fused.plumes
        ),
    )


def draw_null(views: Views) -> NullLevel:
    """The null that `fuse` draws of these views."""
    rng = np.random.default_rng(0)
    return NullLevel.from_views(views, views.volume(), rng, progress=lambda _: None)


@dataclass(frozen=True, kw_only=True)
class TruePlume:
    """Where a plume stands: an upright column of fusion, and its distance from the cameras."""

    column: PlumeColumn
    range_m: float

    @classmethod
    def of(cls, leak: simulated.PlumeSpec, trajectory: Trajectory) -> "TruePlume":
        column = PlumeColumn(np.array([*leak.source, 0, 0, leak.height_m, leak.radius_m, 0]))
        away = np.linalg.norm(trajectory.centers_in_world - np.array(leak.source), axis=1)
        return cls(column=column, range_m=float(away.mean()))

    def off(self, column: PlumeColumn) -> float:
        return column.gap_to(self.column) / self.range_m

    def stated(self, plume: Plume) -> Stated:
        off = self.off(axis_of(plume))
        return Stated(nats=plume.evidence_nats, probability=plume.probability, off=off)


def strongest_column(views: Views, null: NullLevel, true: TruePlume) -> Stated:
    """The strongest column, searched for as in the draws of chance."""
    rng = np.random.default_rng(0)
    starts = propose_columns(views, views.volume(), most=MOST_PROPOSALS)[0].columns
    columns = fit_columns(partial(column_evidence, views), starts, views.unit, rng)
    if not len(columns):
        return NO_COLUMN
    nats = float(column_evidence(views, columns[0].as_columns)[0])
    return Stated(nats=nats, probability=1 - null.false_alarm(nats), off=true.off(columns[0]))


def axis_of(plume: Plume) -> PlumeColumn:
    """A plume of the map as a column of fusion; of its width nothing is asked."""
    slopes = plume.axis[:2] / plume.axis[2]
    height = plume.extent_high * plume.axis[2]
    return PlumeColumn(np.array([*plume.source, *slopes, height, 0, 0]))
