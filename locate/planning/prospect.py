"""What a camera would show of two usual plumes from some usual ranges."""

from geometry.refraction import AMBIENT_TEMPERATURE_K
from geometry.rising_plume import RisingPlume
from locate.planning.plan import Coding, Plan, PlannedSource, PlannedView

RANGES_M = ((3.0, 6.0), (5.0, 10.0), (10.0, 20.0), (20.0, 40.0))
"""To the plume and to its background."""
RISE_K, RADIUS_M, LEAK_KGPS = 100.0, 0.1, 0.005
SOURCES = {
    f"air {RISE_K:.0f} K warmer, radius {RADIUS_M:g} m": PlannedSource(
        temperature_k=AMBIENT_TEMPERATURE_K + RISE_K, plume=RisingPlume.of_source(RADIUS_M)
    ),
    f"methane, {1000 * LEAK_KGPS:g} g/s": PlannedSource(
        gas="methane",
        plume=RisingPlume.of_leak(
            LEAK_KGPS, gas="methane", mole_fraction=1.0, temperature_k=AMBIENT_TEMPERATURE_K
        ),
    ),
}


def strengths_px(size: tuple[int, int], focal_px: float, coding: Coding) -> dict[str, list[float]]:
    """Of each usual plume, its strength in px at each of `RANGES_M`, in frames of this size."""

    def strength_px(source: PlannedSource, ranges_m: tuple[float, float]) -> float:
        view = PlannedView(
            width=size[0],
            height=size[1],
            focal_px=focal_px,
            range_to_plume_m=ranges_m[0],
            range_to_background_m=ranges_m[1],
        )
        return Plan(source=source, view=view, coding=coding).strength_px

    return {
        name: [strength_px(source, ranges_m) for ranges_m in RANGES_M]
        for name, source in SOURCES.items()
    }
