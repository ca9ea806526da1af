"""The camera of a transforms.json (nerfstudio, instant-ngp, Polycam, LichtFeld): all or refused."""

import re
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from geometry.camera import HALF_PIXEL, Camera
from geometry.errors import BadInputError
from geometry.json_values import as_number, as_whole_number
from geometry.lens_keys import is_lens_key, is_nothing, refuse_unread_terms

LENS_TERMS: dict[str, tuple[str, ...]] = {
    "SIMPLE_PINHOLE": (),
    "PINHOLE": (),
    "SIMPLE_RADIAL": ("k1",),
    "RADIAL": ("k1", "k2"),
    "OPENCV": ("k1", "k2", "p1", "p2"),
    "FULL_OPENCV": ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    "SIMPLE_RADIAL_FISHEYE": ("k1",),
    "RADIAL_FISHEYE": ("k1", "k2"),
    "OPENCV_FISHEYE": ("k1", "k2", "k3", "k4"),
    "THIN_PRISM_FISHEYE": ("k1", "k2", "p1", "p2", "k3", "k4", "sx1", "sy1"),
}
"""Keys of each model's lens, in COLMAP's order."""
READ_AS = {
    "SIMPLE_PINHOLE": "OPENCV",
    "PINHOLE": "OPENCV",
    "SIMPLE_RADIAL": "OPENCV",
    "RADIAL": "OPENCV",
    "SIMPLE_RADIAL_FISHEYE": "OPENCV_FISHEYE",
    "RADIAL_FISHEYE": "OPENCV_FISHEYE",
}
"""Models that are another one with further terms at zero."""
ALIASES = {"model": "camera_model", "fx": "fl_x", "fy": "fl_y", "width": "w", "height": "h"}
"""Names that Polycam and others give to the same values."""
_NAME_OF_MODEL = re.compile(r"[A-Z_]+", re.IGNORECASE)
"""What a camera model may be called; the model of a device has digits or blanks."""
INTRINSICS = frozenset(("fl_x", "fl_y", "cx", "cy", "w", "h")) | {
    "camera_angle_x",
    "camera_angle_y",
    "camera_model",
    "is_fisheye",
}
"""Keys of a camera that every model may have."""
SAME_CAMERA_PX = 0.05
"""Cameras whose pixels lie this near to each other are one camera, rounded; chosen."""
FARTHEST_CENTRE = 0.3
"""Distance of the principal point from the middle, over the side, beyond which it is of images of
another size; chosen."""
SAME_FOCAL = 0.02
"""Relative difference of a focal length and that of the angle of view beside it; chosen."""
NAMED_CAMERAS = 4
"""Most cameras that a refusal describes."""
GRID = 9
"""Pixels along each side of the image at which cameras are compared."""


def is_same_camera(a: Camera, b: Camera) -> bool:
    """True where both see every part of the image at the same pixels, to within rounding."""
    if a == b:
        return True
    if (a.width, a.height) != (b.width, b.height):
        return False
    across, down = np.linspace(0, a.width - 1, GRID), np.linspace(0, a.height - 1, GRID)
    pixels = np.stack(np.meshgrid(across, down), axis=-1)
    off = np.abs(b.project(a.rays(pixels)) - pixels)
    return bool((off < SAME_CAMERA_PX).all())


def merge_cameras(cameras: Iterable[tuple[str, Camera]]) -> Camera:
    """The one camera that all of them are.

    Args:
        cameras: Name and camera of each image.

    Raises:
        BadInputError: There is none, or they are different ones: how many images of each.
    """
    groups: list[tuple[Camera, list[str]]] = []
    for name, camera in cameras:
        same = (names for known, names in groups if is_same_camera(known, camera))
        names = next(same, None)
        if names is None:
            groups.append((camera, [name]))
        else:
            names.append(name)
    if not groups:
        raise BadInputError("0 cameras; expected the images of one camera")
    if len(groups) > 1:
        groups.sort(key=lambda group: len(group[1]), reverse=True)
        listed = "; ".join(
            f"{len(names)} of {camera.model} {camera.width}x{camera.height} with "
            f"{camera.focal_px:.5g} px ({names[0]} ...)"
            for camera, names in groups[:NAMED_CAMERAS]
        )
        more = len(groups) - NAMED_CAMERAS
        raise BadInputError(
            f"the images are of {len(groups)} cameras: {listed}"
            + (f"; and {more} more" if more > 0 else "")
            + "; a run has one: give the images of one lens and zoom, or one camera for all with "
            "--camera"
        )
    return groups[0][0]


def read_transforms_camera(
    content: Mapping[str, Any], frames: Iterable[Mapping[str, Any]]
) -> Camera:
    """The camera of all frames of a transforms.json, whose own values go before those for all.

    Raises:
        BadInputError: Something of it is not known, or the frames are of several cameras.
        KeyError, TypeError, ValueError: A value is missing or no number.
    """
    frames = list(frames)
    for block in (content, *frames):
        _refuse_nested_terms(block)
    common = _rename_aliases(content)
    if not frames:
        return read_camera_block(common)
    read: dict[str, Camera] = {}
    cameras = []
    for frame in frames:
        renamed = _rename_aliases(frame).items()
        own = {k: value for k, value in renamed if k in INTRINSICS or is_lens_key(k)}
        label = repr(sorted(own.items()))
        if label not in read:
            read[label] = read_camera_block({**common, **own})
        cameras.append((str(frame["file_path"]), read[label]))
    return merge_cameras(cameras)


def read_camera_block(block: Mapping[str, Any]) -> Camera:
    """The camera of one block of keys.

    Raises:
        BadInputError: A key or the model is not known, or the size or focal length is missing.
        TypeError, ValueError: A value is no number.
    """
    model = _model_of(block)
    terms = LENS_TERMS[model]
    refuse_unread_terms(block, INTRINSICS | set(terms), f"camera model {model}")
    lens = [0.0 if block.get(k) is None else as_number(block[k], k) for k in terms]
    model = READ_AS.get(model, model)
    if model in ("OPENCV", "FULL_OPENCV") and not any(lens):
        model, lens = "PINHOLE", []
    elif model == "FULL_OPENCV" and not any(lens[4:]):
        model, lens = "OPENCV", lens[:4]
    else:
        lens += [0.0] * (len(LENS_TERMS[model]) - len(lens))
    width, height = _whole_px(block, "w"), _whole_px(block, "h")
    focal_x, focal_y = _focal_lengths(block, width, height, fisheye="FISHEYE" in model)
    cx = as_number(block.get("cx", width / 2), "cx")
    cy = as_number(block.get("cy", height / 2), "cy")
    params = (focal_x, focal_y, cx - HALF_PIXEL, cy - HALF_PIXEL, *lens)
    camera = Camera(model=model, width=width, height=height, params=params)
    off = np.abs([cx - width / 2, cy - height / 2])
    if (off > FARTHEST_CENTRE * np.array([width, height])).any():
        raise BadInputError(
            f"cx, cy = {cx:g}, {cy:g} px are far from the middle of {width}x{height} images; give "
            "w, h, cx, cy and fl_x of one size, in px"
        )
    return camera


def write_camera_block(camera: Camera) -> dict[str, Any]:
    """The keys of a camera in a transforms.json.

    Raises:
        BadInputError: The camera model has no counterpart there.
    """
    if camera.model not in LENS_TERMS:
        raise BadInputError(f"transforms.json has no camera model like {camera.model}")
    model = READ_AS.get(camera.model, camera.model)
    shared_focal = camera.model.startswith("SIMPLE_") or camera.model.startswith("RADIAL")
    focal_y = camera.params[0 if shared_focal else 1]
    cx, cy, *lens = camera.params[1 if shared_focal else 2 :]
    block = {
        "camera_model": model,
        "w": camera.width,
        "h": camera.height,
        "fl_x": camera.params[0],
        "fl_y": focal_y,
        "cx": cx + HALF_PIXEL,
        "cy": cy + HALF_PIXEL,
    }
    terms = LENS_TERMS[model]
    return block | dict(zip(terms, [*lens, *[0.0] * (len(terms) - len(lens))], strict=True))


def _refuse_nested_terms(block: Mapping[str, Any]) -> None:
    for key, value in block.items():
        inner = value if isinstance(value, list) and key != "frames" else [value]
        nested = [term for part in inner if isinstance(part, dict) for term in part.items()]
        for name, term in nested:
            is_lens = name in INTRINSICS or name in ALIASES or is_lens_key(str(name))
            if is_lens and not is_nothing(term):
                raise BadInputError(
                    f"{key} holds {name}, which is read only beside frames or in a frame"
                )


def _rename_aliases(block: Mapping[str, Any]) -> dict[str, Any]:
    device = block.get("model") is not None and not _NAME_OF_MODEL.fullmatch(str(block["model"]))
    renamed = {key: value for key, value in block.items() if key not in ALIASES}
    for alias, key in ALIASES.items():
        if alias in block and not (alias == "model" and device):
            if key in renamed and renamed[key] != block[alias]:
                raise BadInputError(f"{key} is {renamed[key]!r} and {alias} {block[alias]!r}")
            renamed[key] = block[alias]
    return renamed


def _model_of(block: Mapping[str, Any]) -> str:
    """The model that a block names, or that its terms need."""
    named = block.get("camera_model")
    model = "OPENCV" if named is None else str(named).upper()
    if model not in LENS_TERMS:
        raise BadInputError(f"camera model {named!r} is not one of {', '.join(LENS_TERMS)}")
    if not is_nothing(block.get("is_fisheye")):
        if named is not None and "FISHEYE" not in model:
            raise BadInputError(f"camera model {named!r} and is_fisheye contradict each other")
        return "OPENCV_FISHEYE" if named is None else model
    if model != "OPENCV":
        return model
    if not is_nothing(block.get("k4")) and not {"k5", "k6"} & block.keys():
        raise BadInputError(
            f"k4 = {block['k4']!r} of camera model OPENCV has two meanings (a power of the radius, "
            "or a denominator); name the model FULL_OPENCV or OPENCV_FISHEYE"
        )
    more = any(not is_nothing(block.get(key)) for key in ("k3", "k4", "k5", "k6"))
    return "FULL_OPENCV" if more else "OPENCV"


def _whole_px(block: Mapping[str, Any], key: str) -> int:
    if block.get(key) is None:
        raise BadInputError("w and h, the size of the images in px, are missing")
    return as_whole_number(block[key], key)


def _focal_lengths(
    block: Mapping[str, Any], width: int, height: int, *, fisheye: bool
) -> tuple[float, float]:
    found: list[float | None] = []
    for axis, side in (("x", width), ("y", height)):
        name = f"camera_angle_{axis}"
        angle = None if fisheye else block.get(name)
        by_angle = None if angle is None else side / 2 / float(np.tan(as_number(angle, name) / 2))
        stated = block.get(f"fl_{axis}")
        focal = by_angle if stated is None else as_number(stated, f"fl_{axis}")
        found.append(focal)
        if by_angle and focal and abs(focal - by_angle) > SAME_FOCAL * by_angle:
            raise BadInputError(
                f"fl_{axis} = {focal:g} px and camera_angle_{axis} = {angle}, which is "
                f"{by_angle:.5g} px, contradict each other; remove the wrong one"
            )
    focal_x, focal_y = found
    either = focal_x if focal_x is not None else focal_y
    if either is None:
        angle_too = "" if fisheye else " or camera_angle_x"
        raise BadInputError(f"the focal length is missing: fl_x{angle_too}")
    return (
        either if focal_x is None else focal_x,
        either if focal_y is None else focal_y,
    )
