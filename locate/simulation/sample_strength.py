"""How strong the plume of the bundled sample is, against a real one."""

from geometry.text_files import read_json
from locate.recording.sample import SAMPLE
from locate.simulation.scene import Scene


def describe_sample_strength() -> str:
    """How many times as much it bends light as the same leak would by physics, in one line."""
    (truth,) = read_json(SAMPLE / "truth.json")["plumes"]
    (leak,) = Scene.load(SAMPLE / "scene.yaml").plumes
    return (
        f"The sample is simulated. Its leak bends light {truth['refractivity_gain']:.0f} times as "
        f"much as {leak.gas} of {leak.temperature_k:g} K from an opening {leak.radius_m:g} m in "
        "radius does: real leaks are fainter, and locate plan says which can be found."
    )
