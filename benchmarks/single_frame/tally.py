"""The pixels of one contender on one background, and the scores of them."""

from collections import defaultdict
from itertools import pairwise

import numpy as np

from benchmarks.single_frame.contenders import MASK_NATS, Answer
from detect.calibration import expected_calibration_error
from detect.learning.dybs_calibration import labels_of
from detect.scores import auroc, average_precision
from detect.synthesis import Sample

THIN = (slice(2, None, 5),) * 2
PEAKS_PX = (0.08, 0.12, 0.18, 0.27, 0.4, 0.6, 1.1)


class SampleTally:
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
        precision = f"{positive[mask].mean():.2f} of {mask.sum()}" if mask.any() else "none"
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
