"""Robots known by name: the file each comes in, its tool and its locked joints."""

import importlib.util
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import metadata, resources
from pathlib import Path

from roadmap.errors import BadRobot, did_you_mean
from roadmap.ranges import check_path

# What brings the files, and the remedy where it is absent.
_HOW = {
    "maps": "install odm-planner again",
    "pybullet": "run \"pip install 'odm-planner[sim]'\" (wheels for Python 3.11 only)",
    "example-robot-data": "run \"pip install 'odm-planner[robots]'\"",
}
_EXAMPLES = "cmeel.prefix/share/example-robot-data/robots"


@dataclass(frozen=True)
class KnownRobot:
    """A robot that `load_robot` finds by name.

    Attributes:
        origin: What brings its file: "maps" (this package), "pybullet" or
            "example-robot-data".
        file: Path of the URDF inside of it.
        tip: Link of the tool.
        locked: Where joints stand that stand still elsewhere than at 0 [rad or m];
            fingers do not, unless `travel` is empty.
        srdf: File of this package with the link pairs that are not tested, or "".
        endless: Continuous joints that turn without end, whatever limits the file has.
        acceleration, jerk: Joint name -> the maker's limit, which no URDF holds
            [rad/s2, rad/s3].
        travel: Finger joints that may stand anywhere, None: all that can; of hands
            that stand as a grasp says, none.
        payload_kg: What the maker lets it carry, its hand included [kg]; None: we know
            of no figure.
    """

    origin: str
    file: str
    tip: str
    locked: Mapping[str, float] = field(default_factory=dict)
    srdf: str = ""
    acceleration: Mapping[str, float] = field(default_factory=dict)
    jerk: Mapping[str, float] = field(default_factory=dict)
    endless: tuple[str, ...] = ()
    travel: tuple[str, ...] | None = None
    payload_kg: float | None = None


# Baxter's right arm hangs beside the pedestal; its left gripper, if it stands, is open.
_BAXTER = {"right_s1": 1.0, "l_gripper_l_finger_joint": 0.02}

# Franka Control Interface documentation, "Limits for Panda": jerk is 500 times this.
_PANDA_A = (15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0)
_PANDA = {f"panda_joint{k}": a for k, a in enumerate(_PANDA_A, 1)}

# Agents that hand something over or take it: one arm moves at a time. How the other one
# stands: Crichton's hangs, its forearm to the front; DRC-Hubo's is bent, so that it is
# off the floor where it kneels. Hands stand open; a grasp locks them elsewhere.
_OTHER_ARM = {
    "crichton": {"arm_1_joint": 1.5708, "arm_2_joint": 1.35, "arm_3_joint": -1.5708,
                 "arm_4_joint": 1.4},
    "drchubo": {"SP": 0.1, "EP": -1.0},
    "person": {"shoulder_flexion": 0.09, "elbow_flexion": 0.35},
}  # fmt: skip
_SIDES = ("left", "right")


def _agent(name: str, side: str) -> KnownRobot:
    other, turn = ("right", -0.15) if side == "left" else ("left", 0.15)
    locked = {f"{other}_{joint}": at for joint, at in _OTHER_ARM[name].items()}
    if name == "drchubo":
        legs = [f"{s}_{joint}" for s in _SIDES for joint in ("hip", "knee", "ankle")]
        locked |= {f"{other}_SR": turn, **dict.fromkeys(["waist", *legs], 0.0)}
    return KnownRobot("maps", f"{name}.urdf", f"{side}_palm", locked, travel=())


_AGENTS = {f"{name}_{s}": _agent(name, s) for name in _OTHER_ARM for s in _SIDES}

_ROBOTS = {
    "panda": KnownRobot(
        "pybullet",
        "franka_panda/panda.urdf",
        "panda_grasptarget",
        {"panda_finger_joint1": 0.04},
        acceleration=_PANDA,
        jerk={name: 500.0 * a for name, a in _PANDA.items()},
        payload_kg=3.0,
    ),
    "kuka_iiwa": KnownRobot(
        "pybullet", "kuka_iiwa/model.urdf", "lbr_iiwa_link_7", payload_kg=14.0
    ),
    "xarm6": KnownRobot("pybullet", "xarm/xarm6_robot.urdf", "link6", payload_kg=5.0),
    "kawasaki_fs003n": KnownRobot(
        "maps", "kawasaki_fs003n.urdf", "flange", payload_kg=3.0
    ),
    "rail_arm": KnownRobot("maps", "rail_arm.urdf", "tool", {"left_finger": 0.02}),
    "armar3": KnownRobot("maps", "armar3.urdf", "tool"),
    "plain_arm": KnownRobot("maps", "plain_arm.urdf", "tool"),
    "ur5": KnownRobot(
        "example-robot-data",
        "ur_description/urdf/ur5_joint_limited_robot.urdf",
        "tool0",
        payload_kg=5.0,
    ),
    "baxter_left": KnownRobot(
        "example-robot-data",
        "baxter_description/urdf/baxter.urdf",
        "left_gripper",
        _BAXTER,
        "baxter_left.srdf",
    ),
    "kinova": KnownRobot(
        "example-robot-data",
        "kinova_description/robots/kinova.urdf",
        "j2s6s200_end_effector",
        # Jaco user guide: these turn without end; the file says one turn each way
        endless=tuple(f"j2s6s200_joint_{k}" for k in (1, 4, 6)),
    ),
    **_AGENTS,
}


def robot_names() -> list[str]:
    """Return the names that `load_robot` takes in place of a file."""
    return sorted(_ROBOTS)


def known_robot(name: str | os.PathLike) -> KnownRobot | None:
    """Return what is known of a robot of that name, None for any other source."""
    return _ROBOTS.get(str(name))


def robot_file(source: str | os.PathLike) -> Path:
    """Return the URDF of a known name, or the file that `source` itself names.

    BadRobot lists the names, or says how to install what brings the file.
    """
    path = check_path("a robot", source, "give a name, or a URDF's path")
    robot = known_robot(source)
    if robot is None:
        if path.is_file():
            return path
        if path.is_dir():
            raise BadRobot(
                f"{str(path)!r} is a folder, no URDF file; give the path of a .urdf "
                "file"
            )
        raise BadRobot(_unknown(str(source)))
    folder = _folder(robot.origin)
    if folder is None:
        raise BadRobot(
            f"the robot {str(source)!r} comes with {robot.origin}, which is not "
            f"installed here; {_HOW[robot.origin]} or give the path of a URDF"
        )
    if not (folder / robot.file).is_file():
        raise BadRobot(
            f"the robot {str(source)!r} should be in {robot.file} of {robot.origin}, "
            f"but the installed version has no such file; {_HOW[robot.origin]} with "
            "--upgrade or give the path of a URDF"
        )
    return folder / robot.file


def own_file(name: str) -> Path:
    """Return a file that this package brings along, a URDF, SRDF or recipe."""
    return Path(str(resources.files("maps"))) / name


def _folder(origin: str) -> Path | None:
    """Return the folder that `KnownRobot.file` starts from, None if not installed."""
    if origin == "maps":
        return own_file("")
    if origin == "pybullet":
        spec = importlib.util.find_spec("pybullet_data")
        places = list(spec.submodule_search_locations or []) if spec else []
        return Path(places[0]) if places else None
    try:
        found = metadata.distribution(origin)
    except metadata.PackageNotFoundError:
        return None
    return Path(str(found.locate_file(_EXAMPLES)))


def _unknown(source: str) -> str:
    return (
        f"there is no URDF file at {source!r}, and no known robot has that name; "
        f"{did_you_mean(source, robot_names())} the path of a .urdf file or one of "
        f"{', '.join(robot_names())}"
    )
