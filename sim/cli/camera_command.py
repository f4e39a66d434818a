"""`odm camera`: one depth image against a map, as cells, counts and a picture."""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from sim.terminal.checks import PICTURE, PIXELS, PLACE, TURN, Limits
from sim.terminal.flags import (
    Json,
    MapOption,
    argument,
    flag,
    from_request,
    optional,
    refuse_beside,
)
from sim.terminal.output import FINDING, leave, report

if TYPE_CHECKING:
    import numpy as np

    from odm import CellMap, SeenSpace
    from odm.cameras import Seen

LARGEST = 16384  # pixels a side
_CAMERA = "Camera"
_CELLS = "Cells"
Three = tuple[float, float, float]
Six = tuple[float, float, float, float, float, float]
# an Intel RealSense SR305, 640 x 480
_FX, _CX, _CY, _SCALE = 476.007, 313.683, 242.755, 0.000125
_SIZE = (640, 480)
_POINT = (PLACE, PLACE, PLACE)
_CENTRE = Limits(-LARGEST, LARGEST, "pixels")


@dataclass(frozen=True)
class CameraRequest:
    """What `odm camera` is asked for."""

    file: Path = argument(..., "A 16-bit depth image, one channel.", metavar="PNG")
    map_dir: MapOption
    eye: Three = flag(
        (0.0, -0.45, 0.75),
        "Where it is, base frame, m.",
        metavar="X Y Z",
        panel=_CAMERA,
        limits=_POINT,
    )
    at: Three = flag(
        (0.65, 0.0, 0.5),
        "What it looks at, base frame, m; up in the image is z, straight below x.",
        metavar="X Y Z",
        panel=_CAMERA,
        limits=_POINT,
    )
    pose: Six | None = optional(
        "Instead: pose of its axes (x right, y down, z forward), base frame, m, "
        "degrees.",
        metavar="X Y Z ROLL PITCH YAW",
        panel=_CAMERA,
        limits=(*_POINT, TURN, TURN, TURN),
    )
    fx: float = flag(_FX, "Focal length, pixels.", panel=_CAMERA, limits=PIXELS)
    fy: float | None = optional(
        "The same along v; default: fx.", panel=_CAMERA, limits=PIXELS
    )
    cx: float = flag(_CX, "Principal point, pixels.", panel=_CAMERA, limits=_CENTRE)
    cy: float = flag(_CY, "Principal point, pixels.", panel=_CAMERA, limits=_CENTRE)
    scale: float = flag(
        _SCALE,
        "Metres per pixel unit.",
        panel=_CAMERA,
        limits=Limits(0.0, 1.0, "m", above=True, hint="pixels in mm have 0.001"),
    )
    clear: float | None = optional(
        "A pixel of 65535 says that nothing is nearer than so many m.",
        panel=_CAMERA,
        limits=Limits(0.0, 1000.0, "m", above=True),
    )
    q: str | None = optional(
        "The robot's joints, rad or m; default: mid-range.", metavar="Q1,Q2,..."
    )
    d_self: float | None = optional(
        "Take the robot's own points away, within so many m of its cover.",
        panel=_CELLS,
        limits=Limits(0.0, 0.01, "m"),
    )
    flying: float | None = optional(
        "Take flying pixels away, so many m from both neighbours.",
        panel=_CELLS,
        limits=Limits(0.001, 1.0, "m"),
    )
    shadow: bool = flag(True, "What is behind a surface blocks.", panel=_CELLS)
    policy: str = flag(
        "free",
        "What cells that are not seen are.",
        metavar="free|occupied|keep",
        panel=_CELLS,
    )
    plot: Path | None = optional("Draw the cells beside the image.", writes=PICTURE)
    json: Json = None


@from_request(CameraRequest)
def camera(request: CameraRequest) -> None:
    """Tell which cells of a map a depth image shows occupied, free or not at all.

    Without options the intrinsics are those of an Intel RealSense SR305 with
    640 x 480 pixels, and the camera stands beside the robot, looking forward.

    Exit code 1: the image is unfit, and a robot would hold.
    """
    from odm import DepthCamera, SeenSettings, SeenSpace, load_map

    if request.pose is not None:
        what = "a camera without --pose, which says it all"
        refuse_beside(request, ("eye", "at"), what, "leave one of both")
    cell_map = load_map(request.map_dir)
    joints = _configuration(cell_map, request.q)
    image = read_depth_png(request.file)
    height, width = image.shape
    _check_lens(request, width, height)
    camera = DepthCamera(
        width,
        height,
        request.fx,
        request.fx if request.fy is None else request.fy,
        request.cx,
        request.cy,
        _pose(request.eye, request.at, request.pose),
        request.scale,
        request.file.name,
        request.clear,
    )
    settings = SeenSettings(
        d_self=request.d_self,
        flying_m=request.flying,
        shadow=request.shadow,
        policy=request.policy,
    )
    space = SeenSpace(cell_map, camera, settings)
    found = space.update(image, joints, 0.0)
    if found.trouble is not None:
        leave(found.trouble, FINDING)
    facts = describe_frame(space, found, image, joints)
    if request.plot is not None:
        from sim.draw.camera_picture import plot_cells

        facts["plot"] = str(plot_cells(space, image, joints, request.plot))
    report(facts, request.json, lambda facts: _show(request.file, facts))


def _check_lens(request: CameraRequest, width: int, height: int) -> None:
    """Refuse an image of another size than that of intrinsics left at their default."""
    from roadmap.errors import BadInput

    lens = {"--fx": _FX, "--cx": _CX, "--cy": _CY}
    left = [word for word, value in lens.items() if getattr(request, word[2:]) == value]
    if left and (width, height) != _SIZE:
        raise BadInput(
            f"{request.file} has {width} x {height} pixels, but the intrinsics that "
            f"are taken by default are for {_SIZE[0]} x {_SIZE[1]}; give "
            f"{', '.join(left)} of this camera at this size"
        )


def read_depth_png(path: Path) -> "np.ndarray":
    """Read a 16-bit PNG of one channel as (height, width) uint16."""
    import numpy as np
    from PIL import Image, UnidentifiedImageError

    from roadmap.errors import BadInput

    try:
        with Image.open(path) as image:
            if max(image.size) > LARGEST:
                raise BadInput(
                    f"{path} has {image.size[0]} x {image.size[1]} pixels; no camera "
                    f"has more than {LARGEST} a side"
                )
            mode, pixels = image.mode, np.array(image)
    except BadInput:
        raise
    except (
        UnidentifiedImageError,
        SyntaxError,
        ValueError,
        Image.DecompressionBombError,
    ) as error:
        raise BadInput(f"{path} is no image; give a 16-bit PNG") from error
    except OSError as error:
        if error.filename is not None:  # there is no such file, or it cannot be read
            raise
        raise BadInput(
            f"{path} cannot be read to its end ({error}); copy the image again"
        ) from error
    wide = mode.startswith("I;16") or mode == "I"
    if not wide or pixels.ndim != 2 or pixels.min() < 0 or pixels.max() > 65535:
        raise BadInput(
            f"{path} has pixels of mode {mode}; a depth image has one channel of 16 "
            "bits (mode I;16)"
        )
    return pixels.astype(np.uint16)


def describe_frame(
    space: "SeenSpace", seen: "Seen", image: "np.ndarray", q: "np.ndarray"
) -> dict:
    """Return what a frame shows, as plain data for JSON."""
    import numpy as np

    camera, counts = space.cameras[0], space.counts()
    valid = image[(image > 0) & (image < 65535)] * camera.scale
    far = max(valid.max(initial=0.0), camera.clear_m if seen.readings["clear"] else 0.0)
    times = []
    for k in range(9):  # the first frame of a process loads the kernels
        begun = time.process_time()
        space.update(image, q, 0.033 * (k + 1))
        times.append(1e3 * (time.process_time() - begun))
    return {
        "image": {"width": camera.width, "height": camera.height} | seen.readings,
        "scale": camera.scale,
        "depth_m": [
            round(float(np.percentile(valid, p)), 4) for p in (0, 50, 100) if len(valid)
        ],
        "removed": seen.removed,
        "cells": counts,
        "points": len(seen.points),
        "covering_radius_m": seen.covering_radius,
        "certified": seen.certified,
        "thinnest_m": camera.thinnest(float(far)),
        "cpu_ms": round(float(np.median(times)), 3),
        "map_hash": space.cell_map.hash,
    }


def _pose(eye: Three, at: Three, pose: Six | None) -> "np.ndarray":
    import numpy as np

    from odm.cameras import look_at
    from roadmap.transforms import pose_of

    if pose is None:
        straight = eye[:2] == at[:2]  # down from a ceiling, or up
        return look_at(eye, at, (1.0, 0.0, 0.0) if straight else (0.0, 0.0, 1.0))
    return pose_of(pose[:3], np.radians(pose[3:]))


def _configuration(cell_map: "CellMap", q: str | None) -> "np.ndarray":
    import numpy as np

    from odm.checks import check_configuration
    from roadmap.errors import BadInput
    from roadmap.robot.joint_values import check_values

    robot = cell_map.robot
    if q is None:
        return 0.5 * (robot.lower + robot.upper)
    try:
        joints = np.array([float(word) for word in q.replace(",", " ").split()])
    except ValueError as error:
        raise BadInput(f"--q {q!r} is no list of numbers; write 0,-0.4,0") from error
    check_configuration(robot, joints, None)
    return check_values(robot, joints, f"--q {q}", typed=True)


def _show(file: Path, facts: dict) -> None:
    from rich.console import Console

    from sim.tables.fitted import table_of

    console, image = Console(), facts["image"]
    rows = ((name, str(n)) for name, n in facts["cells"].items())
    console.print(table_of(str(file), ("cells", "number"), rows))
    pixels = image["width"] * image["height"]
    radius_cm, thinnest_mm = 100 * facts["covering_radius_m"], 1e3 * facts["thinnest_m"]
    lines = [
        f"{image['valid']} of {pixels} pixels have a reading{_range(facts)}; "
        f"{image['outside']} lie outside the grid.",
        f"{facts['points']} points for the planner, covering radius {radius_cm:.2f} "
        f"cm; certified: {facts['certified']}; things thinner than "
        f"{thinnest_mm:.1f} mm may be missed.",
        f"{facts['cpu_ms']:.2f} ms of CPU time a frame.",
    ]
    if image["clear"]:
        lines.append(f"{image['clear']} are clear: nothing is within --clear.")
    if image["flying"]:
        lines.append(f"{image['flying']} flying pixels were left out.")
    for link, n in facts["removed"].items():
        lines.append(f"{n} points were taken for {link}'s own.")
    for line in lines:
        console.print(line, highlight=False)


def _range(facts: dict) -> str:
    """Return how far away readings are, and by which unit; nothing where none is."""
    if not facts["depth_m"]:
        return ""
    low, middle, high = facts["depth_m"]
    return (
        f", {low:.2f} to {high:.2f} m away (median {middle:.2f} m) where a unit is "
        f"{1e3 * facts['scale']:g} mm (--scale)"
    )
