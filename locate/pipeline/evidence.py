"""The summed evidence of a run as a file."""

from pathlib import Path

import numpy as np

from geometry.grid import EvidenceGrid
from geometry.npz import save_arrays


def save_evidence(grid: EvidenceGrid, threshold_nats: float, path: Path) -> None:
    """Writes evidence.npz.

    Summed llr and weight (Z, Y, X), the lowest corner, the voxel's edge, and what counted as a
    plume.
    """
    save_arrays(
        path,
        llr=grid.llr.astype(np.float16),
        weight=grid.weight.astype(np.float16),
        low_in_world=grid.box.low_in_world,
        voxel=grid.box.voxel,
        threshold_nats=threshold_nats,
    )
