"""Random sources and cameras, as a plan and as a scene."""

from dataclasses import dataclass

import numpy as np

from geometry.refraction import density_deficit
from geometry.rising_plume import RisingPlume
from locate.planning.plan import Plan, PlannedSource, PlannedView
from locate.simulation.camera_paths import simulate_trajectory
from locate.simulation.capture import CaptureSetup, build_surfaces
from locate.simulation.plume_field import PlumeField
from locate.simulation.render import Renderer
from locate.simulation.scene import (
    CameraBlock,
    ImageBlock,
    PathBlock,
    PlumeSpec,
    Scene,
    VideoBlock,
    WallObject,
)

EXIT_M = 20.0
"""Height of the sources, so that the ground is in no one's way."""
GASES = ("air", "methane", "propane", "hydrogen", "helium", "co2", "sf6")
VIEWS_OF_A_FLOW = 3
FRAMES, FPS = 6, 2.0
"""Of a turbulent flow."""


@dataclass(frozen=True)
class Setup:
    """A source and a camera, planned and simulated.

    Attributes:
        plan: Without the window of a measurement, which the simulator does not have.
        scene: The same as a scene, the camera at rest.
    """

    plan: Plan
    scene: Scene

    def displacements(self) -> np.ndarray:
        """(N, H, W, 2) px in each of the frames: where rays go that are bent."""
        renderer = Renderer(
            self.scene,
            build_surfaces(CaptureSetup(scene=self.scene)),
            [PlumeField(self.scene, 0)],
            simulate_trajectory(self.scene),
        )
        frames = range(self.scene.video.frames)
        return np.array([renderer.render_frame(frame)[1].displacement for frame in frames])


def straight_setup(number: int) -> Setup:
    """A column of hot air or gas that neither spreads nor thins, before a random camera."""
    rng = np.random.default_rng([20261201, number])
    gas = str(rng.choice(GASES))
    hot_k = float(rng.uniform(300, 700))
    width = int(rng.choice([160, 200, 240]))
    range_m = float(rng.uniform(2, 20))
    behind_m = range_m * float(rng.uniform(0.2, 4))
    focal_px = width * float(rng.uniform(0.6, 1.5))
    source = PlannedSource(
        gas=gas,
        mole_fraction=1.0 if gas == "air" else float(rng.uniform(0.2, 1)),
        temperature_k=hot_k if gas == "air" else 288.0,
        plume=RisingPlume(radius_m=range_m * float(rng.uniform(5, 12)) / focal_px, spread=0.0),
    )
    view = PlannedView(
        width=width,
        height=width * 3 // 4,
        focal_px=focal_px,
        range_to_plume_m=range_m,
        range_to_background_m=range_m + behind_m,
    )
    plume = PlumeSpec(
        kind="gaussian",
        source=(0, 0, EXIT_M),
        radius_m=source.plume.radius_m,
        height_m=0.6 * view.shown_m,
        gas=gas,
        mole_fraction=source.mole_fraction,
        temperature_k=source.temperature_k,
    )
    plan = Plan(source=source, view=view, window_px=0.0)
    return Setup(plan, _scene(view, plume, VideoBlock(frames=1), rng))


def turbulent_setup(number: int) -> Setup:
    """A turbulent plume of the simulator, as wide and warm as a plant's, before a random camera."""
    rng = np.random.default_rng([20261202, number // VIEWS_OF_A_FLOW])
    gas = str(rng.choice(GASES)) if rng.random() < 0.5 else "air"
    plume = PlumeSpec(
        source=(0, 0, EXIT_M),
        radius_m=float(rng.uniform(0.1, 0.17)),
        height_m=float(rng.uniform(3, 4)),
        gas=gas,
        mole_fraction=1.0 if gas == "air" else float(rng.uniform(0.2, 1)),
        temperature_k=float(rng.uniform(360, 500)) if gas == "air" else 288.0,
        flow_seed=number // VIEWS_OF_A_FLOW,
    )
    rng = np.random.default_rng([20261203, number])
    width = int(rng.choice([160, 200, 240]))
    focal_px = width * float(rng.uniform(0.6, 1.5))
    height = width * 3 // 4
    range_m = plume.height_m * focal_px / height * float(rng.uniform(1.1, 1.6))
    view = PlannedView(
        width=width,
        height=height,
        focal_px=focal_px,
        range_to_plume_m=range_m,
        range_to_background_m=range_m * float(rng.uniform(1.2, 5)),
    )
    source = PlannedSource(
        gas=gas,
        mole_fraction=plume.mole_fraction,
        temperature_k=plume.temperature_k,
        plume=RisingPlume.of_source(plume.radius_m),
    )
    plan = Plan(source=source, view=view, window_px=0.0)
    return Setup(plan, _scene(view, plume, VideoBlock(frames=FRAMES, fps=FPS), rng))


def _scene(
    view: PlannedView, plume: PlumeSpec, video: VideoBlock, rng: np.random.Generator
) -> Scene:
    falls = density_deficit(plume.gas, plume.mole_fraction, plume.temperature_k) < 0
    middle_m = EXIT_M + (-0.5 if falls else 0.5) * plume.height_m
    aside_m = 0.1 * view.shown_m * float(rng.uniform(-1, 1))
    wall_m = view.range_to_background_m - view.range_to_plume_m + 0.15
    return Scene(
        camera=CameraBlock(width=view.width, height=view.height, focal_px=view.focal_px),
        video=video,
        image=ImageBlock(samples=1, noise=0),
        path=PathBlock(
            kind="hover",
            target=(aside_m, 0, middle_m),
            radius_m=view.range_to_plume_m,
            height_m=middle_m + view.range_to_plume_m * float(rng.uniform(-0.15, 0.15)),
            start_deg=-90 + float(rng.uniform(-15, 15)),
        ),
        objects=(
            WallObject(
                kind="wall", start=(-900, wall_m), end=(900, wall_m), height_m=2 * EXIT_M + 100
            ),
        ),
        plumes=(plume,),
    )
