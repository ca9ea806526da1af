"""Scene objects as triangles, each with its place on the surface's texture."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from geometry.arrays import FloatArray
from locate.simulation.materials import MATERIALS
from locate.simulation.scene import (
    BoxObject,
    CylinderObject,
    GroundObject,
    PipeRackObject,
    SceneObject,
    TankObject,
    WallObject,
)

CYLINDER_FACETS = 40


@dataclass(kw_only=True)
class TriangleMesh:
    """Triangles of their own corners each, in the world frame.

    Attributes:
        corners: (3, 3) corners of each.
        normals: (3, 3) outward unit normals at the corners.
        frames: (2, 4) of each: the place p lies at `frame[:, :3] @ p + frame[:, 3]` on the texture.
        materials: Index into `MATERIALS` of each.
        keys: Number of the solid of each.
    """

    corners: list[FloatArray] = field(default_factory=list)
    normals: list[FloatArray] = field(default_factory=list)
    frames: list[FloatArray] = field(default_factory=list)
    materials: list[int] = field(default_factory=list)
    keys: list[int] = field(default_factory=list)

    def add_quad(
        self, quad: FloatArray, normals: FloatArray, frame: FloatArray, material: int, key: int
    ) -> None:
        """Adds a quad (4, 3), counter-clockwise from outside, as two triangles."""
        for pick in ([0, 1, 2], [0, 2, 3]):
            self.corners.append(quad[pick])
            self.normals.append(normals[pick])
            self.frames.append(frame)
            self.materials.append(material)
            self.keys.append(key)


def build_mesh(objects: tuple[SceneObject, ...]) -> TriangleMesh:
    """All triangles of a scene."""
    mesh = TriangleMesh()
    key = 0
    for thing in objects:
        for solid in _iterate_solids(thing):
            material = list(MATERIALS).index(solid.material)
            if isinstance(solid, BoxObject):
                _add_box(mesh, solid, material, key)
            else:
                _add_cylinder(mesh, solid, material, key)
            key += 1
    return mesh


def _iterate_solids(thing: SceneObject) -> Iterator[BoxObject | CylinderObject]:
    match thing:
        case BoxObject() | CylinderObject():
            yield thing
        case GroundObject():
            size = (thing.extent_m, thing.extent_m, 0.2)
            yield BoxObject(kind="box", center=(0, 0, -0.1), size=size, material=thing.material)
        case WallObject():
            run = np.subtract(thing.end, thing.start)
            middle = np.add(thing.end, thing.start) / 2
            yield BoxObject(
                kind="box",
                center=(middle[0], middle[1], thing.height_m / 2),
                size=(float(np.hypot(*run)), thing.thickness_m, thing.height_m),
                yaw_deg=float(np.degrees(np.arctan2(run[1], run[0]))),
                material=thing.material,
            )
        case PipeRackObject():
            yield from _pipe_rack_parts(thing)
        case TankObject():
            yield from _tank_parts(thing)


def _pipe_rack_parts(rack: PipeRackObject) -> Iterator[BoxObject | CylinderObject]:
    turn = Rotation.from_euler("z", rack.yaw_deg, degrees=True)

    def place(x: float, y: float, z: float) -> tuple[float, float, float]:
        px, py, pz = np.add(turn.apply([x, y, z]), [*rack.center, 0.0])
        return float(px), float(py), float(pz)

    bays = np.linspace(
        -rack.length_m / 2 + 0.2, rack.length_m / 2 - 0.2, max(2, round(rack.length_m / 2.6) + 1)
    )
    top = max(rack.levels_m)
    for x in bays:
        for y in (-rack.width_m / 2, rack.width_m / 2):
            yield BoxObject(
                kind="box",
                center=place(x, y, top / 2),
                size=(0.16, 0.16, top),
                yaw_deg=rack.yaw_deg,
                material="steel",
            )
        for level in rack.levels_m:
            yield BoxObject(
                kind="box",
                center=place(x, 0, level - 0.09),
                size=(0.14, rack.width_m + 0.3, 0.16),
                yaw_deg=rack.yaw_deg,
                material="steel",
            )
    for floor, level in enumerate(rack.levels_m):
        for i, y in enumerate(np.linspace(-0.42, 0.42, rack.pipes) * rack.width_m):
            radius = (0.11, 0.06, 0.085, 0.05)[(i + floor) % 4]
            half = rack.length_m / 2
            yield CylinderObject(
                kind="cylinder",
                start=place(-half, y, level + radius),
                end=place(half, y, level + radius),
                radius_m=radius,
                material=rack.material,
            )
            flange = place(0.3 * rack.length_m * (-1) ** i, y, level + radius)
            along = turn.apply([0.035, 0, 0])
            yield CylinderObject(
                kind="cylinder",
                start=tuple(np.subtract(flange, along).tolist()),
                end=tuple(np.add(flange, along).tolist()),
                radius_m=radius * 1.6,
                material="steel",
            )


def _tank_parts(tank: TankObject) -> Iterator[BoxObject | CylinderObject]:
    x, y = tank.center
    yield CylinderObject(
        kind="cylinder",
        start=(x, y, 0),
        end=(x, y, tank.height_m),
        radius_m=tank.radius_m,
        material=tank.material,
    )
    yield CylinderObject(
        kind="cylinder",
        start=(x, y, 0),
        end=(x, y, 0.15),
        radius_m=tank.radius_m + 0.15,
        material="concrete",
    )
    rim = tank.radius_m - 0.05
    top = tank.height_m
    for angle in np.linspace(0, 2 * np.pi, 10, endpoint=False):
        px, py = x + rim * np.cos(angle), y + rim * np.sin(angle)
        yield CylinderObject(
            kind="cylinder",
            start=(px, py, top),
            end=(px, py, top + 0.9),
            radius_m=0.025,
            material="paint",
        )
    out = tank.radius_m + 0.12
    for side in (-0.2, 0.2):
        yield CylinderObject(
            kind="cylinder",
            start=(x + side, y - out, 0.1),
            end=(x + side, y - out, top + 0.6),
            radius_m=0.03,
            material="paint",
        )
    for z in np.arange(0.4, top, 0.35):
        yield CylinderObject(
            kind="cylinder",
            start=(x - 0.2, y - out, z),
            end=(x + 0.2, y - out, z),
            radius_m=0.02,
            material="paint",
        )


def _add_box(mesh: TriangleMesh, box: BoxObject, material: int, key: int) -> None:
    turn = Rotation.from_euler("z", box.yaw_deg, degrees=True).as_matrix()
    half = np.array(box.size) / 2
    for axis in range(3):
        for sign in (-1.0, 1.0):
            normal = np.zeros(3)
            normal[axis] = sign
            up = np.array([0.0, 1.0, 0.0]) if axis == 2 else np.array([0.0, 0.0, 1.0])
            right = np.cross(up, normal)
            signs = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
            local = np.array([half * (normal + a * right + b * up) for a, b in signs])
            corners = local @ turn.T + box.center
            frame = np.zeros((2, 4))
            frame[:, :3] = [turn @ right, turn @ up]
            frame[:, 3] = -frame[:, :3] @ corners[0]
            mesh.add_quad(corners, np.tile(turn @ normal, (4, 1)), frame, material, key)


def _add_cylinder(mesh: TriangleMesh, cylinder: CylinderObject, material: int, key: int) -> None:
    start, end = np.array(cylinder.start), np.array(cylinder.end)
    axis = (end - start) / np.linalg.norm(end - start)
    e1 = np.cross(axis, [1.0, 0, 0] if abs(axis[0]) < 0.8 else [0, 1.0, 0])
    e1 /= np.linalg.norm(e1)
    e2 = np.cross(axis, e1)
    angles = np.linspace(0, 2 * np.pi, CYLINDER_FACETS + 1)
    rim = np.cos(angles)[:, None] * e1 + np.sin(angles)[:, None] * e2
    chord = 2 * cylinder.radius_m * np.sin(np.pi / CYLINDER_FACETS)
    for k in range(CYLINDER_FACETS):
        a, b = rim[k] * cylinder.radius_m, rim[k + 1] * cylinder.radius_m
        frame = np.zeros((2, 4))
        frame[:, :3] = [(b - a) / chord, axis]
        frame[:, 3] = [k * chord, 0] - frame[:, :3] @ (start + a)
        quad = np.array([start + a, start + b, end + b, end + a])
        mesh.add_quad(
            quad, np.array([rim[k], rim[k + 1], rim[k + 1], rim[k]]), frame, material, key
        )
        for base, outward in ((start, -axis), (end, axis)):
            cap = np.zeros((2, 4))
            cap[:, :3] = [e1, e2]
            ring = np.array([base, base + a, base + b, base])
            mesh.add_quad(ring, np.tile(outward, (4, 1)), cap, material, key)
