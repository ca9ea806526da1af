"""How much evidence a detector gives a displacement of a known size."""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from geometry.arrays import FloatArray, FloatMap
from geometry.errors import BadInputError
from geometry.json_values import as_number

EDGES = (0.0, *np.geomspace(0.05, 25.6, 10).tolist())
"""Of the bins of |w| / sigma; whatever is larger counts in the last."""
LEAST_IN_BIN = 100


@dataclass(frozen=True, kw_only=True)
class Response:
    """Mean evidence by the true displacement's size in units of the sigma stated beside it.

    Attributes:
        ratios: (B,) |w| / sigma, increasing.
        llr: (B,) nats.
    """

    ratios: tuple[float, ...]
    llr: tuple[float, ...]

    @classmethod
    def from_samples(cls, ratios: FloatArray, llr: FloatArray) -> Self | None:
        """The means over the bins of `EDGES` that enough samples fall into; None of none.

        Args:
            ratios: (N,) true |w| / sigma.
            llr: (N,) nats that the detector gave.
        """
        bins = np.digitize(ratios, EDGES) - 1
        full = [b for b in range(len(EDGES)) if (bins == b).sum() >= LEAST_IN_BIN]
        if not full:
            return None
        return cls(
            ratios=tuple(float(ratios[bins == b].mean()) for b in full),
            llr=tuple(float(llr[bins == b].mean()) for b in full),
        )

    def __call__(self, size_px: FloatMap, sigma_px: FloatMap) -> FloatMap:
        """(H, W) nats to expect, linear between the ratios and constant beyond them."""
        return np.asarray(np.interp(size_px / sigma_px, self.ratios, self.llr), np.float32)

    def to_plain(self) -> dict[str, Any]:
        """As JSON knows it."""
        return {"ratios": list(self.ratios), "llr": list(self.llr)}

    @classmethod
    def from_plain(cls, content: Any, where: str) -> Self:
        """Reads what `to_plain` made.

        Raises:
            BadInputError: It is something else.
        """
        try:
            ratios, llr = (
                tuple(as_number(value, name) for value in content[name])
                for name in ("ratios", "llr")
            )
        except (KeyError, TypeError, ValueError) as error:
            raise BadInputError(f"{where}: not a response ({error!r})") from error
        finite = np.isfinite([*ratios, *llr]).all()
        if not ratios or len(ratios) != len(llr) or not finite or (np.diff(ratios) <= 0).any():
            raise BadInputError(f"{where}: a response needs an llr for each of increasing ratios")
        return cls(ratios=ratios, llr=llr)
