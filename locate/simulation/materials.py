"""What the surfaces of a plant are made of."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Material:
    """One kind of surface; lengths in m, tones as shares of the albedo.

    Attributes:
        albedo: Mean reflectance.
        cell_w: Width of a plate or brick; 0 for none.
        cell_h: Its height.
        stagger: Shift of every second course, in cell widths.
        joint: Width of the joint.
        joint_tone: Reflectance change in the joint.
        spread: Standard deviation of the tone from cell to cell.
        grain: Weight of the fine noise.
        stain: Weight of the coarse noise.
        stones: Weight of the gravel tile.
        rust: Share of the surface that is flaked or rusty.
        ribs: Spacing of corrugation; 0 for none.
        bolts: Spacing of bolts along the joints; 0 for none.
        marks: Share of mark fields that carry lettering.
    """

    albedo: float = 0.4
    cell_w: float = 0.0
    cell_h: float = 1.0
    stagger: float = 0.0
    joint: float = 0.01
    joint_tone: float = -0.4
    spread: float = 0.0
    grain: float = 0.1
    stain: float = 0.12
    stones: float = 0.0
    rust: float = 0.0
    ribs: float = 0.0
    bolts: float = 0.0
    marks: float = 0.0


MATERIALS = {
    "brick": Material(
        albedo=0.34,
        cell_w=0.26,
        cell_h=0.095,
        stagger=0.5,
        joint=0.014,
        joint_tone=0.45,
        spread=0.2,
        grain=0.12,
        stain=0.14,
        marks=0.05,
    ),
    "concrete": Material(
        albedo=0.46,
        cell_w=2.4,
        cell_h=1.2,
        joint=0.018,
        spread=0.09,
        grain=0.14,
        stain=0.2,
        bolts=0.6,
        marks=0.12,
    ),
    "block": Material(
        albedo=0.42,
        cell_w=0.41,
        cell_h=0.2,
        stagger=0.5,
        joint=0.013,
        joint_tone=-0.25,
        spread=0.11,
        grain=0.15,
        stain=0.15,
        marks=0.06,
    ),
    "cladding": Material(
        albedo=0.5,
        cell_w=1.05,
        cell_h=3.1,
        joint=0.02,
        spread=0.07,
        grain=0.06,
        stain=0.14,
        ribs=0.21,
        bolts=0.35,
        rust=0.06,
        marks=0.15,
    ),
    "plate": Material(
        albedo=0.52,
        cell_w=1.5,
        cell_h=0.75,
        stagger=0.5,
        joint=0.014,
        spread=0.06,
        grain=0.07,
        stain=0.16,
        rust=0.1,
        bolts=0.25,
        marks=0.25,
    ),
    "paint": Material(
        albedo=0.44,
        cell_w=0.9,
        cell_h=2.2,
        joint=0.03,
        joint_tone=-0.3,
        spread=0.12,
        grain=0.08,
        stain=0.12,
        rust=0.16,
        marks=0.12,
    ),
    "steel": Material(
        albedo=0.3,
        cell_w=1.2,
        cell_h=1.2,
        joint=0.012,
        spread=0.1,
        grain=0.1,
        stain=0.14,
        rust=0.22,
        bolts=0.2,
    ),
    "planks": Material(
        albedo=0.42,
        cell_w=1.3,
        cell_h=0.14,
        stagger=0.37,
        joint=0.012,
        joint_tone=-0.6,
        spread=0.16,
        grain=0.15,
        stain=0.1,
        marks=0.3,
        bolts=0.6,
    ),
    "asphalt": Material(
        albedo=0.2,
        cell_w=6.0,
        cell_h=4.0,
        joint=0.04,
        spread=0.06,
        grain=0.2,
        stain=0.25,
        stones=0.1,
        marks=0.06,
    ),
    "gravel": Material(albedo=0.36, grain=0.1, stain=0.2, stones=0.36),
    "grid": Material(
        albedo=0.6, cell_w=0.07, cell_h=0.07, joint=0.035, joint_tone=-0.6, grain=0, stain=0
    ),
    "waves": Material(albedo=0.6, ribs=0.07, grain=0, stain=0),
    "field": Material(
        albedo=0.3,
        cell_w=1.7,
        cell_h=0.9,
        stagger=0.37,
        joint=0.1,
        joint_tone=-0.25,
        spread=0.2,
        grain=0.14,
        stain=0.22,
    ),
}
