"""How surfaces look: noise, and man-made structure computed at each hit.

A surface's radiance is a fixed function of the place on it, so nothing in a rendered image says
whether the ray that fetched it was bent. Structure (joints, bolts, marks) is averaged exactly over
the footprint of a ray; noise comes from tiles band-limited by mip levels.
"""

from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from geometry.arrays import FloatMap
from locate.simulation.materials import MATERIALS, Material
from locate.simulation.textures import CLOUDS, GRAIN, STONES, TextureAtlas

CLOUD_SCALE = 9.0
MATERIAL_PARAMETERS = np.array(
    [
        [getattr(material, field.name) for field in fields(Material)]
        for material in MATERIALS.values()
    ],
    dtype=np.float32,
)


def _hash_to_unit(*keys: NDArray[np.int32]) -> FloatMap:
    """A number in [0, 1) for each tuple of integers, the same on every machine."""
    mixed = np.zeros(keys[0].shape, dtype=np.uint32)
    for key, prime in zip(keys, (0x9E3779B1, 0x85EBCA77, 0xC2B2AE3D, 0x27D4EB2F), strict=False):
        mixed ^= key.astype(np.uint32) * np.uint32(prime)
        mixed ^= mixed >> np.uint32(15)
        mixed *= np.uint32(0x2C1B3C6D)
        mixed ^= mixed >> np.uint32(12)
    return np.asarray(mixed >> np.uint32(8), dtype=np.float32) * np.float32(2**-24)


def _bar_coverage(distance: FloatMap, width: FloatMap, footprint: FloatMap) -> FloatMap:
    """Share of the footprint covered by a bar of `width` whose middle is `distance` away."""
    half = width / 2
    upper = np.clip(distance + footprint / 2, -half, half)
    lower = np.clip(distance - footprint / 2, -half, half)
    return np.asarray((upper - lower) / footprint, dtype=np.float32)


def _offset_to_nearest(value: FloatMap, period: FloatMap) -> FloatMap:
    return np.asarray(value - np.round(value / period) * period, dtype=np.float32)


def _bolt_row_distance(distance: FloatMap) -> FloatMap:
    """Distance from the row of bolts that runs beside a joint."""
    return np.asarray(np.abs(distance) - 0.06, dtype=np.float32)


def _lettering_mask(u: FloatMap, v: FloatMap, key: NDArray[np.int32], share: FloatMap) -> FloatMap:
    """Rows of glyphs of 3 x 5 random dots, stencilled on some fields of 1.7 x 0.9 m; 0 or 1."""
    field_u, field_v = np.floor(u / 1.7), np.floor(v / 0.9)
    fu, fv = field_u.astype(np.int32), field_v.astype(np.int32)
    dot = 0.022 + 0.03 * _hash_to_unit(fu, fv, key + 5)
    col = np.floor((u - field_u * 1.7 - 0.25) / dot).astype(np.int32)
    row = np.floor((v - field_v * 0.9 - 0.3) / dot).astype(np.int32)
    glyph, dot_col = np.divmod(col, 4)
    lit = _hash_to_unit(fu * 31 + glyph, fv * 17 + row, dot_col, key) > 0.4
    inside = (glyph >= 0) & (glyph < 6) & (dot_col < 3) & (row >= 0) & (row < 5)
    return np.asarray(lit & inside & (_hash_to_unit(fu, fv, key) < share), dtype=np.float32)


def compute_reflectance(
    atlas: TextureAtlas,
    material: NDArray[np.int32],
    key: NDArray[np.int32],
    u: FloatMap,
    v: FloatMap,
    footprint: FloatMap,
) -> FloatMap:
    """What share of the light each place on a surface sends back.

    Args:
        atlas: The noise.
        material: (N,) index into `MATERIALS`.
        key: (N,) number of the object, so that no two look alike.
        u: (N,) place along the surface, m, horizontal where there is such a direction.
        v: (N,) place along the surface, m, across `u`.
        footprint: (N,) width of the ray there, m.

    Returns:
        (N,) reflectance.
    """
    (
        albedo,
        cell_w,
        cell_h,
        stagger,
        joint,
        joint_tone,
        spread,
        grain,
        stain,
        stones,
        rust,
        ribs,
        bolts,
        marks,
    ) = (MATERIAL_PARAMETERS[:, i].take(material) for i in range(MATERIAL_PARAMETERS.shape[1]))
    shift = _hash_to_unit(key) * 40
    ground = atlas.sample_texture(u + shift, v, GRAIN, footprint)
    turned = atlas.sample_texture(
        0.82 * u - 0.57 * v, 0.57 * u + 0.82 * v + shift, GRAIN, footprint
    )
    clouds = atlas.sample_texture(
        u / CLOUD_SCALE + shift, v / CLOUD_SCALE, CLOUDS, footprint / CLOUD_SCALE
    )
    tone = 1 + grain * (ground + 0.8 * turned) + stain * clouds
    gravel = stones > 0
    if gravel.any():
        u_g, v_g, f_g = u[gravel], v[gravel], footprint[gravel]
        layers = atlas.sample_texture(u_g, v_g, STONES, f_g) + 0.6 * atlas.sample_texture(
            1.1 * u_g - 1.5 * v_g, 1.5 * u_g + 1.1 * v_g, STONES, 1.86 * f_g
        )
        tone[gravel] += stones[gravel] * layers
    tone *= _structure_tone(
        u, v, key, footprint, cell_w, cell_h, stagger, joint, joint_tone, spread, bolts
    )
    ribbed = ribs > 0
    tone[ribbed] *= 1 + 0.16 * np.sin(2 * np.pi * u[ribbed] / ribs[ribbed]) * np.exp(
        -((2.5 * footprint[ribbed] / ribs[ribbed]) ** 2)
    )
    flaked = np.clip((0.6 * turned + 0.8 * clouds + 2.2 * rust - 1.3) * 3, 0, 1) * (rust > 0)
    tone *= 1 - 0.45 * flaked
    lettered = marks > 0
    tone[lettered] *= 1 - 0.6 * _lettering_mask(
        u[lettered], v[lettered], key[lettered], marks[lettered]
    )
    return np.asarray(np.clip(albedo * tone, 0.01, 0.95), dtype=np.float32)


def _structure_tone(
    u: FloatMap,
    v: FloatMap,
    key: NDArray[np.int32],
    footprint: FloatMap,
    cell_w: FloatMap,
    cell_h: FloatMap,
    stagger: FloatMap,
    joint: FloatMap,
    joint_tone: FloatMap,
    spread: FloatMap,
    bolts: FloatMap,
) -> FloatMap:
    """Tone of plates or bricks: one each, with joints between them and bolts beside the joints."""
    celled = cell_w > 0
    width = np.where(celled, cell_w, 1).astype(np.float32)
    course = np.floor(v / cell_h)
    along = u + stagger * width * (course % 2)
    column = np.floor(along / width)
    cell_tone = _hash_to_unit(column.astype(np.int32), course.astype(np.int32), key) - 0.5
    across_u, across_v = _offset_to_nearest(along, width), _offset_to_nearest(v, cell_h)
    in_joint = np.maximum(
        _bar_coverage(across_u, joint, footprint), _bar_coverage(across_v, joint, footprint)
    )
    tone = 1 + np.sqrt(12) * spread * cell_tone
    tone = tone * (1 + joint_tone * in_joint)
    bolted = bolts > 0
    pitch = np.where(bolted, bolts, 1).astype(np.float32)
    head = np.full_like(footprint, 0.045)
    beside_u = _bar_coverage(_bolt_row_distance(across_u), head, footprint) * _bar_coverage(
        _offset_to_nearest(v, pitch), head, footprint
    )
    beside_v = _bar_coverage(_bolt_row_distance(across_v), head, footprint) * _bar_coverage(
        _offset_to_nearest(along, pitch), head, footprint
    )
    tone = tone * (1 - 0.5 * np.maximum(beside_u, beside_v) * bolted)
    return np.asarray(np.where(celled, tone, 1), dtype=np.float32)
