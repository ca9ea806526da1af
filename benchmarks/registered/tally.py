"""Thinned pixels of many frames by both contenders, and the scores of them."""

from collections import defaultdict
from collections.abc import Iterator

import numpy as np

from detect.evidence import displacement_evidence
from detect.learning.clips import TrainingClip
from detect.learning.registered_calibration import Read, read_clip
from detect.registered.detector import pixel_trust as trust_in
from detect.registered.evidence_network import EvidenceNetwork
from detect.registered.features import decode_feature
from detect.scores import auroc, average_precision
from geometry.arrays import FloatMap

THIN = (slice(1, None, 4),) * 2


def by_hand(read: Read) -> tuple[FloatMap, FloatMap]:
    """(H, W) llr and (H, W, 2) displacement that `registered-plain` has for these features."""
    inputs = read.inputs
    x, y = decode_feature(inputs, "displacement_x"), decode_feature(inputs, "displacement_y")
    displacement = np.stack([x, y], axis=-1)
    sigma_px = np.where(
        read.output.measured, decode_feature(inputs, "log_sigma"), np.float32(np.inf)
    )
    trust = trust_in(decode_feature(inputs, "visible"), decode_feature(inputs, "log_depth_edge"))
    texture = decode_feature(inputs, "log_texture")
    llr, _ = displacement_evidence(displacement, sigma_px, texture, trust)
    return llr, displacement


class ClipTally:
    """Thinned pixels of many frames, by contender."""

    def __init__(self, network: EvidenceNetwork) -> None:
        self._network, self._calibration = network, network.read_calibration()
        self._columns: defaultdict[str, list[np.ndarray]] = defaultdict(list)

    def add(self, clip: TrainingClip, seed: int) -> None:
        for read in read_clip(self._network, clip):
            here = read.counts[THIN]
            hand_llr, hand_displacement = by_hand(read)
            output = read.output
            maps = {
                "positive": read.positive,
                "place": output.surfaces,
                "plain": hand_llr,
                "learned": output.llr(self._calibration),
                "logit": output.scores[..., 0],
                "size": np.linalg.norm(read.truth, axis=-1),
                "sigma": output.sigma_px,
                "plain error": np.linalg.norm(hand_displacement - read.truth, axis=-1),
                "learned error": np.linalg.norm(output.displacement - read.truth, axis=-1),
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
