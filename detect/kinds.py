"""The detectors by name, each with its weights and its own rules for decisions by its evidence."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from scipy.special import expit

import detect
from detect.bos import BosDetector
from detect.detection import Detector
from detect.registered import RegisteredDetector
from geometry.arrays import FloatArray, GreyImage
from geometry.errors import BadInputError

PACKAGE = Path(detect.__file__).parent


@dataclass(frozen=True, kw_only=True)
class DetectorInputs:
    """What detectors are made with besides weights; each takes what it needs.

    Attributes:
        neighbours: How many other frames ``registered`` compares each with.
        points_in_world: (N, 3) sparse points of the scene, for ``registered``.
        reference: (H, W), the view without plume, for ``bos``.
    """

    neighbours: int = 8
    points_in_world: FloatArray | None = None
    reference: GreyImage | None = None


@dataclass(frozen=True, kw_only=True)
class PlumeReliability:
    """How often plumes of so much evidence a view are true: a logistic curve.

    Attributes:
        offset: Logit at no evidence.
        slope_per_nat: What each nat a view adds to the logit.
    """

    offset: float
    slope_per_nat: float

    def true_share(self, evidence_nats: float, views: int) -> float:
        """The share of plumes that are true, of those with this evidence in all views together."""
        return float(expit(self.offset + self.slope_per_nat * evidence_nats / views))


@dataclass(frozen=True, kw_only=True)
class DetectorKind:
    """One detector by itself.

    Attributes:
        name: As stored in index.json and map.json.
        build: Makes it, given weights or None; None where nothing is known but the name.
        installed_weights: Where its weights are installed; None where it has none.
        clutter_nats: What a plume must have for every view that was summed.
        reliability: Caps the probability of its plumes; None leaves it to chance alone.
        empty_frames_note: For frames without any evidence, `{empty}` of `{frames}`.
        empty_frames_advice: What else to try with them.
    """

    name: str
    build: Callable[[DetectorInputs, Path | None], Detector] | None = None
    installed_weights: Path | None = None
    clutter_nats: float = 0.0
    reliability: PlumeReliability | None = None
    empty_frames_note: str | None = None
    empty_frames_advice: str | None = None

    @property
    def takes_weights(self) -> bool:
        """Whether it reads a file of weights."""
        return self.installed_weights is not None

    def find_weights(self, given: Path | None = None) -> Path | None:
        """The file given, else the installed one, else None; None too where it takes none."""
        if self.installed_weights is None:
            return None
        if given is not None:
            return given
        return self.installed_weights if self.installed_weights.is_file() else None

    def make(self, inputs: DetectorInputs, weights: Path | None = None) -> Detector:
        """The detector with the weights given, else with those installed.

        Raises:
            BadInputError: There is no such detector, or its weights are missing or not its own.
        """
        if self.build is None:
            raise BadInputError(f"no detector is called {self.name!r}")
        return self.build(inputs, self.find_weights(weights))


def _build_registered(inputs: DetectorInputs, weights: Path | None) -> Detector:
    return RegisteredDetector(
        neighbours=inputs.neighbours, points_in_world=inputs.points_in_world, weights=weights
    )


def _build_bos(inputs: DetectorInputs, _: Path | None) -> Detector:
    return BosDetector(reference=inputs.reference)


def _build_dybs(_: DetectorInputs, weights: Path | None) -> Detector:
    if weights is None:
        raise BadInputError("dybs has no weights installed; give some with --weights FILE.onnx")
    from detect.dybs import DybsDetector

    return DybsDetector(weights)


CLUTTER_NATS = 5.0
"""Nats a view. The network errs alike from all sides, which draws of chance do not show. In ten
development scenes without a plume the strongest column had 19 nats of 16 views, in nine real
recordings 61: 80 are required of 16."""

LEARNED_RELIABILITY = PlumeReliability(offset=-2.002, slope_per_nat=0.446)
"""By logistic regression over the strongest plumes of 55 random plants
(`python -m benchmarks.reliability`; docs/seeing.md lists them, and the results on others)."""

EMPTY_FRAMES_NOTE = (
    "{empty} of {frames} frames hold no evidence: they could not be registered well enough for "
    "what the network has learned (little overlap, or much that moves)."
)
WITHOUT_NETWORK = (
    "--detector registered-plain evaluates frames without evidence without the network."
)

REGISTERED = DetectorKind(
    name="registered",
    build=_build_registered,
    installed_weights=PACKAGE / "registered" / "weights" / "registered.onnx",
    clutter_nats=CLUTTER_NATS,
    reliability=LEARNED_RELIABILITY,
    empty_frames_note=EMPTY_FRAMES_NOTE,
    empty_frames_advice=WITHOUT_NETWORK,
)
"""Learned where weights are installed, else as `REGISTERED_PLAIN`."""
REGISTERED_PLAIN = DetectorKind(name="registered-plain", build=_build_registered)
BOS = DetectorKind(name="bos", build=_build_bos)
DYBS = DetectorKind(
    name="dybs",
    build=_build_dybs,
    installed_weights=PACKAGE / "dybs" / "weights" / "lite-fast.onnx",
)
