"""What a run would state of a recording, held against the truth."""

from collections.abc import Iterator
from dataclasses import asdict, dataclass

import numpy as np

from benchmarks.common.filmed import Recorded, labels
from benchmarks.reliability.outcomes import Candidate, RecordingOutcome, StatedPlume
from benchmarks.reliability.recordings import condition_of, is_held_out, leak_of
from detect.registered import RegisteredDetector
from detect.registry import DetectorChoice
from geometry.trajectory import Trajectory
from locate.fusion.find import FoundPlumes, find_plumes
from locate.fusion.matched.plumes import strength_of_plume, strength_of_turn
from locate.fusion.search.columns import PlumeColumn
from locate.fusion.views import Views
from locate.map.plume import Plume
from locate.simulation import scene as simulated

MOST_TURNS = 5
"""Of a recording, that are kept as candidates."""


def evaluate_recording(
    seed: int, sequence: Recorded, detector: RegisteredDetector
) -> RecordingOutcome:
    """What a run would state of a recording."""
    views = views_of_recording(sequence, detector)
    found = find_plumes(views, DetectorChoice.parse(detector.name), response=detector.response)
    true = TruePlume.of(leak_of(seed), sequence.trajectory)
    positive, _ = labels(sequence, list(range(len(views))))
    size = np.linalg.norm(sequence.truth, axis=-1)[positive]
    return RecordingOutcome(
        condition=condition_of(seed),
        held_out=is_held_out(seed),
        amplitude_px=max((p.amplitude_px or 0.0 for p in sequence.scene.plumes), default=0.0),
        strength_px=float(size.mean()) if size.size else 0.0,
        limit_px=found.limit_px,
        candidates=tuple(candidates(found, true)),
        plumes=tuple(true.stated(plume) for plume in found.plumes),
    )


def views_of_recording(sequence: Recorded, detector: RegisteredDetector) -> Views:
    """What the key frames of a recording show."""
    units = sequence.inverse_depth_units.tolist()
    detections = [
        detector.to_detection(*each) for each in zip(sequence.measurements, units, strict=True)
    ]
    return Views.from_detections(detections, sequence.trajectory)


def candidates(found: FoundPlumes, true: "TruePlume") -> Iterator[Candidate]:
    """What the evidence of pixels alone would call plumes, and the strongest turns."""
    rng, turns = np.random.default_rng(0), found.turns
    if turns is None:
        return
    for plume in found.by_pixels.plumes:
        strength = strength_of_plume(turns.score, plume, rng)
        yield Candidate(**asdict(strength), off=true.off(axis_of(plume)))
    for turn in turns.find_turns(rng)[:MOST_TURNS]:
        strength = strength_of_turn(turns.score, turn, rng)
        yield Candidate(**asdict(strength), off=true.off(turn.column))


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

    def stated(self, plume: Plume) -> StatedPlume:
        error = plume.source - self.column.lowest_point
        return StatedPlume(
            probability=plume.probability,
            off=self.off(axis_of(plume)),
            error=float(np.linalg.norm(error)) / self.range_m,
            nees=float(error @ np.linalg.pinv(plume.source_covariance) @ error),
        )


def axis_of(plume: Plume) -> PlumeColumn:
    """A plume of the map as a column of fusion; of its width nothing is asked."""
    slopes = plume.axis[:2] / plume.axis[2]
    height = plume.extent_high * plume.axis[2]
    return PlumeColumn(np.array([*plume.source, *slopes, height, 0, 0]))
