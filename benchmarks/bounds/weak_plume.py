"""A weak plume before a moving camera: what `registered` makes of it, beside an ideal observer.

    OMP_NUM_THREADS=1 python -m benchmarks.bounds weak-plume [--amplitudes PX ...] [--out DIR]

A plant as of `benchmarks.scenes orbit`, at 320x240, with a steady column, noise 1/255, true poses.
Writes bounds_weak_plume.csv: how many sigmas the plume shows in a frame (medians) and in all key
frames together. The ideal observer knows the plume's displacement, the scene without noise and the
noise; each line takes one thing from it. And bounds_registered.csv: the error of the displacement
outside the plume against the bound of its window, medians by texture.
"""

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Self

import numpy as np

from benchmarks.bounds.displacement import NOISE, displacement_bound, noise_variance, slopes
from benchmarks.common.csv_tables import DOCS, Row, write_table
from benchmarks.real_frames.displacement import informed_over_true, signal_over_noise
from detect.detection import Frames
from detect.registered import RegisteredDetector
from detect.registered.registration import WINDOW_PX, Measurement
from geometry.arrays import FloatMap, GreyImage
from locate.fusion.matched.plumes import TurnSearch
from locate.fusion.search.columns import PlumeColumn
from locate.fusion.search.proposals import MOST_PROPOSALS, propose_columns
from locate.fusion.views import Views
from locate.pipeline.detections import ENDS
from locate.recording.spacing import spread_key_rows
from locate.simulation import random_scene
from locate.simulation.camera_paths import simulate_trajectory
from locate.simulation.capture import CaptureSetup, build_surfaces
from locate.simulation.plume_field import PlumeField
from locate.simulation.render import Renderer
from locate.simulation.scene import CameraBlock, Scene

AMPLITUDES_PX = (0.1, 0.03)
"""95th percentiles of |w|."""
NEIGHBOURS = 8
CAMERA = CameraBlock(width=320, height=240, focal_px=330)
STILL_SHARE = 0.03
"""Of the largest displacement: less is outside the plume."""


@dataclass(frozen=True, kw_only=True)
class FrameSigmas:
    """By how many sigmas one frame shows the plume, from the ideal observer down.

    Attributes:
        ideal: The scene is known without noise.
        by_neighbours: It is known as the mean of eight neighbours.
        stated: With the variance that `registered` states: depth is unknown, and errors of the
            model are allowed for.
        kept: As much of the displacement as the measurement holds.
        measured: Against the scatter of the same shape elsewhere in the frame.
    """

    ideal: float
    by_neighbours: float
    stated: float
    kept: float
    measured: float


class RenderedOnDemand(Sequence[GreyImage]):
    """The frames of a scene, each rendered when it is asked for."""

    def __init__(self, scene: Scene) -> None:
        self.trajectory = simulate_trajectory(scene)
        fields = [PlumeField(scene, number) for number in range(len(scene.plumes))]
        surfaces = build_surfaces(CaptureSetup(scene=scene))
        self._renderer = Renderer(scene, surfaces, fields, self.trajectory)
        self.render = cache(self._renderer.render_frame)

    def __len__(self) -> int:
        return len(self.trajectory)

    def __getitem__(self, index: int) -> GreyImage:  # type: ignore[override]
        return self.render(int(index))[0]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--seed", type=int, default=9002)
    parser.add_argument("--amplitudes", type=float, nargs="+", default=AMPLITUDES_PX)
    parser.add_argument("--keys", type=int, default=8)
    parser.add_argument("--out", type=Path, default=DOCS)


def main(options: argparse.Namespace) -> None:
    rows: list[Row] = []
    for amplitude_px in options.amplitudes:
        film = WeakPlumeFilm.render(options.seed, amplitude_px, options.keys)
        rows += sigma_rows(amplitude_px, film.sigmas(), film.turn_sigmas())
    write_table(options.out / "bounds_weak_plume.csv", rows)
    write_table(options.out / "bounds_registered.csv", error_rows(film.errors_in_bounds()))


@dataclass(frozen=True, kw_only=True)
class WeakPlumeFilm:
    """The key frames of a plant with a steady column.

    Attributes:
        column: The plume; its radius is where it displaces most.
        views: All key frames together.
        noiseless: The key frames without noise.
        measured: What is measured of each.
        truths: (H, W, 2) px of each.
    """

    column: PlumeColumn
    views: Views
    noiseless: list[GreyImage]
    measured: list[Measurement]
    truths: list[FloatMap]

    @classmethod
    def render(cls, seed: int, amplitude_px: float, count: int) -> Self:
        scene = random_scene(seed, plume=True, amplitude_px=amplitude_px, noise=NOISE)
        (leak,) = scene.plumes
        steady = leak.model_copy(update={"kind": "gaussian"})
        scene = scene.model_copy(update={"camera": CAMERA, "plumes": (steady,)})
        quiet = scene.model_copy(update={"image": scene.image.model_copy(update={"noise": 0.0})})
        images, noiseless = RenderedOnDemand(scene), RenderedOnDemand(quiet)
        frames = Frames(images=images, trajectory=images.trajectory)
        detector = RegisteredDetector(neighbours=NEIGHBOURS)
        keys = spread_key_rows(len(frames), count, ends=ENDS).tolist()
        known = [each for key in keys if (each := detector.measure(frames, key)) is not None]
        detections = [detector.to_detection(*each) for each in known]
        shape = (0, 0, leak.height_m, leak.radius_m, 0)
        return cls(
            column=PlumeColumn(np.array([*leak.source, *shape])),
            views=Views.from_detections(detections, images.trajectory.take(keys)),
            noiseless=[noiseless[key] for key in keys],
            measured=[measurement for measurement, _ in known],
            truths=[images.render(key)[1].displacement for key in keys],
        )

    @property
    def frames(self) -> Iterator[tuple[GreyImage, Measurement, FloatMap]]:
        return zip(self.noiseless, self.measured, self.truths, strict=True)

    def sigmas(self) -> list[FrameSigmas]:
        return [frame_sigmas(*frame) for frame in self.frames]

    def turn_sigmas(self) -> float:
        """What the search for turns gives the true axis, all views together."""
        grid = propose_columns(self.views, self.views.volume(), most=MOST_PROPOSALS)[1]
        search = TurnSearch.of_views(self.views, grid, np.random.default_rng(0))
        return np.nan if search is None else float(search.score(self.column.as_columns)[0])

    def errors_in_bounds(self) -> list[tuple[FloatMap, FloatMap, FloatMap]]:
        return [error_in_bounds(*frame) for frame in self.frames]


def frame_sigmas(image: GreyImage, measurement: Measurement, truth: FloatMap) -> FrameSigmas:
    """Of one frame; the image is without noise."""
    along_x, along_y = slopes(image)
    change = along_x * truth[..., 0] + along_y * truth[..., 1]
    signal = float(np.sqrt((change.astype(float) ** 2).sum()))
    ideal = signal / np.sqrt(noise_variance(NEIGHBOURS) - NOISE**2 / NEIGHBOURS)
    information = measurement.information
    assert information is not None
    height, width = information.matrix.shape[:2]
    coarse = truth.reshape(height, truth.shape[0] // height, width, -1, 2).mean(axis=(1, 3))
    stated = float(np.sqrt((coarse * information.times(coarse)).sum()))
    return FrameSigmas(
        ideal=ideal,
        by_neighbours=signal / np.sqrt(noise_variance(NEIGHBOURS)),
        stated=stated,
        kept=stated * informed_over_true(information, truth),
        measured=signal_over_noise(information, truth),
    )


def sigma_rows(amplitude_px: float, sigmas: Sequence[FrameSigmas], turn: float) -> list[Row]:
    names = {
        "ideal": "ideal observer",
        "by_neighbours": "knows the scene from eight neighbours only",
        "stated": "variance as stated: depth is unknown, errors are allowed for",
        "kept": "displacement as measured",
        "measured": "scatter as it is elsewhere in the frame",
    }
    ideal = np.array([each.ideal for each in sigmas])
    together = float(np.sqrt((ideal**2).sum()))
    rows = []
    for field, name in names.items():
        one = np.array([getattr(each, field) for each in sigmas])
        rows.append(
            {
                "observer": name,
                "plume": f"of {amplitude_px:g} px",
                "sigmas in a frame": f"{np.median(one):.1f}",
                "ideal over this, in a frame": f"{np.median(ideal / one):.2f}",
                "sigmas in all frames": f"{np.sqrt((one**2).sum()):.1f}",
                "ideal over this, of the bound": f"{together / np.sqrt((one**2).sum()):.2f}",
            }
        )
    rows.append(
        {
            "observer": "search for turns, at the true axis and width",
            "plume": f"of {amplitude_px:g} px",
            "sigmas in a frame": "-",
            "ideal over this, in a frame": "-",
            "sigmas in all frames": f"{turn:.1f}",
            "ideal over this, of the bound": f"{together / turn:.2f}",
        }
    )
    return rows


def error_in_bounds(
    image: GreyImage, measurement: Measurement, truth: FloatMap
) -> tuple[FloatMap, FloatMap, FloatMap]:
    """(M,) texture, squared error and its bound of pixels outside the plume."""
    bound = displacement_bound(image, WINDOW_PX, noise_variance(NEIGHBOURS))
    squares = ((measurement.displacement - truth) ** 2).sum(axis=-1)
    size = np.linalg.norm(truth, axis=-1)
    still = size < STILL_SHARE * size.max()
    still &= measurement.visible > NEIGHBOURS / 2
    return measurement.texture[still], squares[still], bound[still]


def error_rows(errors: Sequence[tuple[FloatMap, FloatMap, FloatMap]]) -> list[Row]:
    texture, squares, bound = (np.concatenate(part) for part in zip(*errors, strict=True))
    edges = np.quantile(texture, [0, 0.2, 0.4, 0.6, 0.8, 1])
    rows = []
    for low, high in pairwise(edges):
        of = (texture >= low) & (texture <= high)
        error, least = np.sqrt(np.median(squares[of])), np.sqrt(np.median(bound[of]))
        rows.append(
            {
                "mean squared gradient, (grey levels / px)^2": f"{low:.1f} to {high:.1f}",
                "error, px": f"{error:.3f}",
                "bound, px": f"{least:.3f}",
                "error, of the bound": f"{error / least:.1f}",
            }
        )
    return rows
