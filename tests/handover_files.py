"""A recorded hand-over made of two models, written as the files of a data set."""

import numpy as np

from handover import Human
from handover.human.body import COLUMN

PARTS = {"hip": "hip", "neck": "neck", "head": "head"}
FRAMES, TAKEN, RELEASED = 40, 20, 25
OBJECT = np.array([0.02, 0.04, 1.05])


def two_people():
    """Return giver and taker, 1.1 m apart, and as they grip on either side."""
    giver = Human(1.7, thickness="mean").placed(-0.5, 0.0, 0.0)
    taker = Human(1.6, thickness="mean").placed(0.5, 0.05, np.pi)
    pairs = []
    for person, along in ((giver, -0.11), (taker, 0.11)):
        held = OBJECT + [along, 0.0, 0.0]
        pairs.append((person, reaching(person, held)))
    return pairs


def reaching(person, place):
    """Return the person with the right grip at a place, somehow."""
    from handover.meet.places import qualities_at

    found = qualities_at(person, "right", place[None], rotations=576)
    return person.with_arm("right", found.q[0])


def write_handover(folder, hand="measured", rate=1.0):
    """Write the files; hand: "measured", "missing" or "copied" from the left one."""
    folder.mkdir(parents=True, exist_ok=True)
    for who, (start, end) in zip(("giver", "taker"), two_people(), strict=True):
        tracks = [_frames(start, end, i) for i in range(FRAMES)]
        for part in tracks[0]:
            rows = [track[part] for track in tracks]
            if part == "RHand" and hand == "copied":
                rows = [track["LHand"] for track in tracks]
            if part == "RHand" and hand == "missing":
                continue
            _write(folder / f"{who}_{part}_pose_saved.csv", rows)
    _write(folder / "baton_pose_saved.csv", [[*OBJECT, 0, 0, 0, 1]] * FRAMES)
    frames = np.arange(FRAMES)
    grips = {"giver": frames < RELEASED, "taker": frames >= TAKEN}
    for who, grip in grips.items():
        lines = [f"0,0,{-8.0 * g},0,0,0" for g in grip]
        text = "\n".join(["Fx,Fy,Fz,Tx,Ty,Tz", *lines]) + "\n"
        (folder / f"Wrench_{who}_saved.csv").write_text(text)
    return folder


def _frames(start, end, i):
    """Return part -> place and quaternion of one frame."""
    share = min(i / TAKEN, 1.0)
    q = (1 - share) * start.arms["right"] + share * end.arms["right"]
    person = start.with_arm("right", q)
    upright = _quaternion(start.T_world_chest[:3, :3] @ _quarter())
    rows = {p: [*person.places[COLUMN[j]], *upright] for p, j in PARTS.items()}
    for side, letter in (("left", "L"), ("right", "R")):
        joints = [
            person.places[COLUMN[f"{side}_{j}"]] for j in ("shoulder", "elbow", "hand")
        ]
        # the right arm's bones lie along -x of their frames
        sign = 1.0 if side == "left" else -1.0
        for name, a, b in zip(("UArm", "FArm"), joints, joints[1:], strict=False):
            rows[letter + name] = [*a, *_quaternion(_along(sign * (b - a)))]
        rows[f"{letter}Hand"] = [*joints[2], 0, 0, 0, 1]
    return rows


def _quarter():
    """Return a rotation: the head's front is -y of its own frame."""
    return np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])


def _along(x):
    x = x / np.linalg.norm(x)
    y = np.cross([0.3, 0.9, 0.2], x)
    y /= np.linalg.norm(y)
    return np.column_stack([x, y, np.cross(x, y)])


def _quaternion(R):
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(R).as_quat()


def _write(path, rows):
    lines = [",".join(f"{v:.9f}" for v in row) for row in rows]
    path.write_text("\n".join(["x,y,z,q0,q1,q2,q3", *lines]) + "\n")
