"""A plan by hand: the small arm carries past a person who reaches into its way."""

from pathlib import Path

import numpy as np
from small import AWAY, DATA, HOME

from handover.human.anthropometry import ARM_JOINTS
from handover.human.postures import HANGING
from handover.scenes.plan_file import FORMAT, VERSION

PERSON = Path(__file__).parent.parent / "maps" / "person.urdf"
BASE = np.array([0.2812, 0.6097, 0.3067])  # of the person, who looks along -y [m]
TURNS = ("turn", "bend", "twist")  # joints of the small arm


def plan_by_hand() -> dict:
    """Return the record of a plan whose receiver reaches when the giver is there."""
    T = np.eye(4)
    T[:3, :3] = [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    T[:3, 3] = BASE
    sits = {"hip": np.pi / 2, "knee": -np.pi / 2, "thumb_flexion": -0.8}
    sits |= {f"finger_{k}_flexion": 0.2 for k in (1, 2, 3)}
    sits |= {f"finger_{k}_bend": 0.1 for k in (1, 2, 3)}
    sits |= {
        joint.replace(" ", "_"): float(np.radians(angle))
        for joint, angle in zip(ARM_JOINTS, HANGING, strict=True)
    }
    rest = ("ankle", "thumb_bend")
    joints = {
        f"{side}_{name}": value
        for side in ("left", "right")
        for name, value in (sits | dict.fromkeys(rest, 0.0)).items()
    }
    reach, mid = "right_shoulder_flexion", 0.5 * (HOME + AWAY)

    def motion(name, who, moved, times, rows):
        rows = np.array(rows, float).reshape(2, -1).tolist()
        return {"name": name, "who": who, "joints": list(moved), "times": times,
                "positions": rows}  # fmt: skip

    return {
        "format": FORMAT,
        "version": VERSION,
        "units": "m, rad, s, kg",
        "scene": {"name": "by hand", "seed": 0},
        "giver": {
            "name": "arm3",
            "urdf": str(DATA / "arm3.urdf"),
            "T_world_base": np.eye(4).tolist(),
            "joints": dict(zip(TURNS, HOME.tolist(), strict=True)),
            "arms": ["left"],
        },
        "receiver": {
            "name": "person",
            "urdf": str(PERSON),
            "T_world_base": T.tolist(),
            "joints": joints,
            "arms": ["right"],
        },
        "scenery": [
            {"name": "box", "type": "box", "size": [0.1, 0.1, 0.1],
             "pose": [[1, 0, 0, 0.0], [0, 1, 0, -0.7], [0, 0, 1, 0.2], [0, 0, 0, 1]]},
        ],
        "motions": [
            motion("carry", "giver", TURNS, [1.0, 3.0], [HOME, mid]),
            motion("offer", "giver", TURNS, [3.0, 5.0], [mid, AWAY]),
            motion("approach", "receiver", [reach], [6.0, 7.0], [joints[reach], 1.57]),
        ],
        "holds": [
            {"who": "world", "link": "", "T_link_object": np.eye(4).tolist(),
             "begin": 0.0, "end": None, "touching": []},
        ],
    }  # fmt: skip
