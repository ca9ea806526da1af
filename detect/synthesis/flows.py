"""Runs of the buoyant flow, kept as potentials whose gradient is the displacement."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Literal, get_args

import numpy as np
import scipy.fft
from scipy.ndimage import gaussian_filter

from detect.synthesis.buoyancy import DIFFUSION_CELLS, BuoyantFlow
from detect.synthesis.split import Split, split_of_run
from geometry.arrays import BoolArray, FloatMap
from geometry.errors import BadInputError
from geometry.npz import open_arrays, save_arrays
from geometry.refraction import AMBIENT_TEMPERATURE_K, density_deficit, refractivity

RunKind = Literal["laminar", "turbulent", "windy", "several", "plate"]
RUN_KINDS: tuple[RunKind, ...] = get_args(RunKind)
CELLS = (48, 48, 96)
CELL_M = 0.02
USED_SHARE = 0.82
"""Share of the solver's box, from the floor, whose fluid has not felt the lid."""
FADE_SHARE = 0.2
BELOW_CELLS = 8
SIDE_CELLS = 12
SMOOTH_CELLS = 0.7
SNAPSHOTS_PER_RUN = 30
INTERVAL_S = 0.08
GASES = ("methane", "helium", "propane", "co2")
GAS_SHARE = 0.25
PEAK_PERCENTILE = 99.9
TURBULENCE_CELLS = 96
RUN_FILES = "run_" + "[0-9]" * 5 + ".npz"


@dataclass(frozen=True, kw_only=True)
class FlowSource:
    """What rises (or sinks) in a run.

    Attributes:
        gas: A name that `geometry.refraction` knows.
        mole_fraction: At the exit.
        temperature_k: At the exit.
    """

    gas: str
    mole_fraction: float
    temperature_k: float

    @classmethod
    def draw(cls, rng: np.random.Generator) -> "FlowSource":
        """Mostly hot air, 60 to 250 K above the surroundings; sometimes a gas."""
        if rng.random() < GAS_SHARE:
            fraction = float(rng.uniform(0.4, 1))
            return cls(
                gas=str(rng.choice(GASES)),
                mole_fraction=fraction,
                temperature_k=AMBIENT_TEMPERATURE_K,
            )
        rise_k = float(rng.uniform(60, 250))
        return cls(gas="air", mole_fraction=1.0, temperature_k=AMBIENT_TEMPERATURE_K + rise_k)

    def excess_refractivity(self, tracer: FloatMap) -> FloatMap:
        """N - 1 above that of the surroundings, where the tracer has this strength."""
        rise_k = self.temperature_k - AMBIENT_TEMPERATURE_K
        n = refractivity(
            self.gas, tracer * self.mole_fraction, AMBIENT_TEMPERATURE_K + tracer * rise_k
        )
        return np.asarray(n - refractivity(), dtype=np.float32)


def simulate_run(number: int, *, moments: int = SNAPSHOTS_PER_RUN) -> FloatMap:
    """One run: a flow of one kind (`number` counts through them) with random parameters.

    Args:
        number: Seeds the run, and sets its kind and its split.
        moments: Snapshots; each is seen from two sides.

    Returns:
        (2 * moments, H, W) potentials, normalised by `normalise_potential`.
    """
    rng = np.random.default_rng([7, number])
    source = FlowSource.draw(rng)
    flow = _random_flow(RUN_KINDS[number % len(RUN_KINDS)], source, rng)
    flow.develop()
    views = []
    for _ in range(moments):
        flow.advance(INTERVAL_S)
        excess = source.excess_refractivity(np.clip(flow.tracer, 0, 1))
        views += [normalise_potential(_frame_image(excess.sum(axis=axis))) for axis in (0, 1)]
    return np.array(views)


def _random_flow(kind: RunKind, source: FlowSource, rng: np.random.Generator) -> BuoyantFlow:
    deficit = abs(density_deficit(source.gas, source.mole_fraction, source.temperature_k))
    laminar = kind == "laminar"
    radius_cells = rng.uniform(2, 4.5) if laminar else rng.uniform(2.5, 8)
    count = int(rng.integers(2, 4)) if kind == "several" else 1
    spread_m = 0.2 * CELLS[0] * CELL_M if count > 1 else 0.0
    return BuoyantFlow(
        CELLS,
        cell_m=CELL_M,
        radius_m=float(radius_cells / (1 if count == 1 else 1.8)) * CELL_M,
        deficit=max(deficit, 0.05),
        exit_mps=float(rng.uniform(0.1, 0.5)),
        rng=rng,
        centers_m=[tuple(xy) for xy in rng.uniform(-spread_m, spread_m, (count, 2)).tolist()],
        turbulence=float(rng.uniform(0, 0.15) if laminar else rng.uniform(0.5, 1.5)),
        diffusion_cells=DIFFUSION_CELLS * float(rng.uniform(2, 4) if laminar else 1),
        wind_mps=float(rng.uniform(0.15, 0.6)) if kind == "windy" else 0.0,
        solid=_draw_plate(rng) if kind == "plate" else None,
    )


def _draw_plate(rng: np.random.Generator) -> BoolArray:
    """(X, Y, Z) a thin plate over the exit, off its middle, sometimes sloping."""
    x, y, z = np.indices(CELLS) - (np.array(CELLS)[:, None, None, None] - 1) / 2
    height = (rng.uniform(0.2, 0.4) - 0.5) * CELLS[2]
    slope = rng.uniform(-0.6, 0.6)
    edge, half_width = rng.uniform(-4, 4), rng.uniform(6, 14)
    reach = (x > edge) & (x < edge + 2 * half_width) & (np.abs(y) < half_width)
    return np.asarray(reach & (np.abs(z - height - slope * (x - edge)) < 1.5))


def _frame_image(integral: FloatMap) -> FloatMap:
    """An integral over (across, up) as an image, faded out above the used part and below."""
    used = int(CELLS[2] * USED_SHARE)
    fade = np.clip((used - np.arange(used)) / (FADE_SHARE * used), 0, 1)
    image = np.pad((integral[:, :used] * fade).T[::-1], ((0, BELOW_CELLS), (0, 0)), mode="edge")
    image[-BELOW_CELLS:] *= (0.5 + 0.5 * np.cos(np.pi * np.linspace(0, 1, BELOW_CELLS)))[:, None]
    across = np.arange(image.shape[1])
    inward = np.minimum(across, across[::-1]) / SIDE_CELLS
    image *= np.sin(np.pi / 2 * np.clip(inward, 0, 1)) ** 2
    return np.asarray(gaussian_filter(np.pad(image, 3), SMOOTH_CELLS), dtype=np.float32)


def random_turbulence(rng: np.random.Generator) -> FloatMap:
    """A potential with a random power-law spectrum under a soft envelope, made in no time.

    A deflection is the gradient of a line integral and has no curl, so the potential is drawn
    and not the displacement.
    """
    n = TURBULENCE_CELLS
    waves = np.hypot(scipy.fft.fftfreq(n)[:, None], scipy.fft.rfftfreq(n)) * n
    outer, inner, slope = rng.uniform(2, 6), rng.uniform(12, 24), rng.uniform(2.5, 4)
    amplitude = (waves**2 + outer**2) ** (-slope / 2) * np.exp(-((waves / inner) ** 2))
    spectrum = scipy.fft.rfft2(rng.standard_normal((n, n))) * amplitude
    noise = scipy.fft.irfft2(spectrum, s=(n, n))
    y, x = np.mgrid[:n, :n] / n - 0.5
    wide, tall = rng.uniform(0.06, 0.16), rng.uniform(0.12, 0.16)
    envelope = np.exp(-(x**2) / (2 * wide**2) - y**2 / (2 * tall**2))
    return normalise_potential(np.asarray(noise * envelope, dtype=np.float32))


def potential_gradient(potential: FloatMap) -> FloatMap:
    """(H, W, 2) the gradient of a potential, x right, y down, per cell."""
    along_y, along_x = np.gradient(potential)
    return np.stack([along_x, along_y], axis=-1)


def normalise_potential(potential: FloatMap) -> FloatMap:
    """The potential scaled until its steepest slopes (99.9th percentile) are 1 per cell."""
    steepness = np.linalg.norm(potential_gradient(potential), axis=-1)
    peak = float(np.percentile(steepness[steepness > 0.01 * steepness.max()], PEAK_PERCENTILE))
    return potential / np.float32(peak)


def write_run(folder: Path, number: int, *, moments: int = SNAPSHOTS_PER_RUN) -> Path:
    """Simulates run `number` into FOLDER/run_00000.npz unless it is there; 20 to 40 CPU s."""
    path = folder / f"run_{number:05d}.npz"
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        save_arrays(path, potentials=simulate_run(number, moments=moments))
    return path


def runs_in(folder: Path, split: Split) -> tuple[Path, ...]:
    """The run files of a folder that belong to a split, sorted.

    Raises:
        BadInputError: There are none.
    """
    numbered = {int(path.stem.removeprefix("run_")): path for path in folder.glob(RUN_FILES)}
    runs = tuple(numbered[n] for n in sorted(numbered) if split_of_run(n) == split)
    if not runs:
        raise BadInputError(f"{folder}: no simulated runs for the {split} split, make ten or more")
    return runs


@lru_cache(maxsize=256)
def read_run(path: Path) -> FloatMap:
    """(N, H, W) the potentials of a run.

    Raises:
        BadInputError: The file is missing or broken.
    """
    with open_arrays(path, "a simulated run") as file:
        return np.asarray(file["potentials"], dtype=np.float32)
