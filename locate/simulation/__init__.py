"""Recordings with a known truth: a scene, plumes that bend its light, and a camera that moves."""

from locate.simulation.campaign import Campaign, is_campaign, simulate_campaign
from locate.simulation.layouts import random_scene
from locate.simulation.photo_overlay import (
    render_onto,
    render_onto_set,
    render_strengths_onto_set,
)
from locate.simulation.recording import simulate
from locate.simulation.scene import Scene

__all__ = [
    "Campaign",
    "Scene",
    "is_campaign",
    "random_scene",
    "render_onto",
    "render_onto_set",
    "render_strengths_onto_set",
    "simulate",
    "simulate_campaign",
]
