"""Lists of poses as text, one a line: TUM, EuRoC and KITTI.

| kind | a line |
|---|---|
| TUM | ``stamp tx ty tz qx qy qz qw``, stamps in s |
| EuRoC | ``stamp, px, py, pz, qw, qx, qy, qz`` and more, stamps in whole ns |
| KITTI | the 12 numbers of the upper three rows of a 4x4 matrix, without a stamp |

All are world_from_cam. Numbers are parted by blanks, commas or semicolons, lines before the first
number that begin with ``#`` or a letter are a header. A header decides where qw stands.
"""

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from geometry.arrays import FloatArray
from geometry.errors import BadInputError
from geometry.text_files import read_text

KINDS = (
    "a line holds 8 numbers, stamp tx ty tz qx qy qz qw (TUM), 12 of a matrix (KITTI), or begins "
    "with a stamp in ns, px, py, pz, qw, qx, qy, qz (EuRoC)"
)
LEAST_NS = 10**15
"""Whole numbers from this on are ns since 1970, not s."""
UNIT_TOLERANCE = 0.05
"""Largest error of the length of a quaternion; files are rounded."""


class PoseList(NamedTuple):
    """What such a file holds.

    Attributes:
        times_s: (N,), None where it has no stamps.
        centers: (N, 3) of the cameras in the world.
        rotations: (N, 3, 3) of cam_from_world.
    """

    times_s: FloatArray | None
    centers: FloatArray
    rotations: FloatArray


def read_pose_list(path: Path) -> PoseList:
    """Reads a list of poses, in order of time where it has stamps.

    Raises:
        BadInputError: It cannot be read, or a line is of no known kind; named.
    """
    text = read_text(path)
    header = ""
    rows: list[tuple[int, list[str]]] = []
    for number, line in enumerate(text.splitlines(), start=1):
        cells = [cell for cell in re.split(r"[\s,;]+", line.strip()) if cell]
        if not cells or line.lstrip().startswith("#") or (not rows and cells[0][0].isalpha()):
            header = header if rows else header + line
            continue
        rows.append((number, cells))
    if not rows:
        raise BadInputError(f"{path}: holds no poses; {KINDS}")
    return _read_rows(path, header.lower(), rows)


def _read_rows(path: Path, header: str, rows: list[tuple[int, list[str]]]) -> PoseList:
    length = len(rows[0][1])
    values = []
    in_ns = rows[0][1][0].isdecimal() and float(rows[0][1][0]) >= LEAST_NS
    for number, cells in rows:
        try:
            numbers = [float(cell) for cell in cells]
            if len(cells) != length or not np.isfinite(numbers).all():
                raise ValueError
            if in_ns and numbers[0] < LEAST_NS:
                raise ValueError
            values.append(numbers)
        except ValueError as error:
            raise BadInputError(f"{path}, line {number}: not a pose; {KINDS}") from error
    table = np.array(values)
    if length == 12 and not in_ns:
        matrices = table.reshape(-1, 3, 4)
        rotations = np.swapaxes(matrices[:, :, :3], 1, 2)
        return PoseList(times_s=None, centers=matrices[:, :, 3], rotations=rotations)
    if length != 8 and not (in_ns and length > 8):
        raise BadInputError(f"{path}, line {rows[0][0]}: {length} numbers; {KINDS}")
    # Whole ns lose nothing that matters as a float: at 1.4e18 ns it is good to 256 ns.
    times_s = table[:, 0] / 1e9 if in_ns else table[:, 0]
    quaternions = table[:, 4:8]
    if _w_is_first(path, header, in_ns):
        quaternions = np.roll(quaternions, -1, axis=1)
    with np.errstate(over="ignore"):
        lengths = np.linalg.norm(quaternions, axis=1)
    if not (np.abs(lengths - 1) < UNIT_TOLERANCE).all():
        worst = rows[int(np.abs(lengths - 1).argmax())][0]
        raise BadInputError(f"{path}, line {worst}: its quaternion is not of length 1; {KINDS}")
    order = np.argsort(times_s, kind="stable")
    rotation = Rotation.from_quat(quaternions[order]).inv()
    return PoseList(
        times_s=times_s[order], centers=table[order, 1:4], rotations=rotation.as_matrix()
    )


def _w_is_first(path: Path, header: str, in_ns: bool) -> bool:
    """Whether qw stands before qx: as the header says, else as is usual of the kind."""
    places = [re.search(rf"\bq_?(?:\w+_)?{axis}\b", header) for axis in "wxz"]
    w, x, z = (None if place is None else place.start() for place in places)
    if w is None or x is None or z is None:
        return in_ns
    if not (w < x < z or x < z < w):
        raise BadInputError(f"{path}: the header names the quaternion in an unknown order")
    return w < x
