"""The detectors that are compared."""

from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

from benchmarks.common.filmed import Recorded
from detect.detection import Detection, Frames
from detect.dybs import DybsDetector
from detect.fused import ERROR_CORRELATION, fuse_pair
from detect.kinds import DYBS, REGISTERED
from detect.registered import RegisteredDetector


class ComparedDetectors:
    """Whoever judges; `learned` and `fused` where weights are installed or given."""

    def __init__(self, weights: Path | None) -> None:
        self._plain = RegisteredDetector()
        learned = REGISTERED.find_weights(weights)
        self._learned = None if learned is None else RegisteredDetector(weights=learned)
        dybs = DYBS.find_weights()
        self._dybs = None if dybs is None else DybsDetector(dybs)

    def detect(self, sequence: Recorded, rows: Sequence[int]) -> dict[str, list[Detection]]:
        """The detections of some key frames, by contender."""
        found = defaultdict(list)
        for k in rows:
            measured = sequence.measurements[k], float(sequence.inverse_depth_units[k])
            found["plain"].append(self._plain.to_detection(*measured))
            best = found["plain"][-1]
            if self._learned is not None:
                best = self._learned.to_detection(*measured)
                found["learned"].append(best)
            if self._dybs is not None:
                found["dybs"].append(self._dybs.detect(Frames(images=list(sequence.images)), k))
                found["fused"].append(fuse_pair(best, found["dybs"][-1], ERROR_CORRELATION))
        return found
