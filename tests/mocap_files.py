"""A person made up for tests, and small recordings of them as .csv and .bvh."""

from pathlib import Path

import numpy as np

RATE = 100.0
STANDING = {  # x to the person's right, y ahead, z up from the floor [m]
    "hip": (0.0, 0.0, 0.95),
    "neck": (0.0, 0.0, 1.45),
    "head": (0.0, 0.03, 1.55),
    "left_shoulder": (-0.19, 0.0, 1.42),
    "left_elbow": (-0.22, 0.0, 1.13),
    "left_hand": (-0.22, 0.05, 0.88),
    "right_shoulder": (0.19, 0.0, 1.42),
    "right_elbow": (0.22, 0.1, 1.15),
    "right_hand": (0.1, 0.35, 1.15),
}
CSV_NAMES = {"neck": "collar"}


def person(n_frames=300, swing=0.15, hz=0.5, rate=RATE):
    """Return joint -> (F, 3): standing, the right hand swings ahead and back [m]."""
    t = np.arange(n_frames) / rate
    joints = {name: np.tile(p, (n_frames, 1)) for name, p in STANDING.items()}
    joints["right_hand"][:, 1] += swing * np.sin(2 * np.pi * hz * t)
    joints["right_elbow"][:, 1] += 0.3 * swing * np.sin(2 * np.pi * hz * t)
    return joints


def write_csv(path, joints, rate=RATE, unit="mm", names=None, frames=None):
    """Write Vicon tracks; z of the file is 0.9 m above the floor, NaN is a gap."""
    scale = {"mm": 1000.0, "cm": 100.0, "m": 1.0}[unit]
    names = CSV_NAMES if names is None else names
    heads, axes, units = [",,"], ["Frame,Sub Frame"], [","]
    for joint in joints:
        name = names.get(joint, joint)
        heads.append(f"Global Angle {name}:{name},,,,,")
        axes.append("RX,RY,RZ,TX,TY,TZ")
        units.append(f"rad,rad,rad,{unit},{unit},{unit}")
    first = f"{rate:g}" if isinstance(rate, float) else rate
    lines = ["Objects", first, heads[0] + ",".join(heads[1:]) + ","]
    lines += [",".join(axes), ",".join(units)]
    n_frames = len(next(iter(joints.values())))
    for i in range(n_frames) if frames is None else frames:
        cells = [str(i + 1), "0"]
        for place in joints.values():
            p = (place[i] - [0, 0, 0.9]) * scale
            seen = np.isfinite(p).all()
            cells += [f"{v:.6f}" for v in (0, 0, 0, *p)] if seen else [""] * 6
        lines.append(",".join(cells))
    Path(path).write_text("\ufeff" + "\n".join(lines) + "\n\n", encoding="utf-8")
    return path


PARENTS = {
    "hip": None,
    "neck": "hip",
    "head": "neck",
    "lShldr": "neck",
    "lForeArm": "lShldr",
    "lHand": "lForeArm",
    "rShldr": "neck",
    "rForeArm": "rShldr",
    "rHand": "rForeArm",
}
BVH_NAMES = dict(zip(STANDING, PARENTS, strict=True))


def write_bvh(path, joints=None, rate=RATE, metres=0.01, up="y", rename=None):
    """Write a .bvh in which every joint has position channels; default is `person`.

    Each joint also has rotation channels, all zero, so that positions are offsets
    from the parent along the file's axes.
    """
    joints = person() if joints is None else joints
    rename = rename or {}
    units = {}
    for joint, name in BVH_NAMES.items():
        p = joints[joint] / metres
        units[name] = p if up == "z" else p[:, [0, 2, 1]] * [1, 1, -1]
    lines, columns = ["HIERARCHY"], []

    def add(name, depth):
        pad, parent = "  " * depth, PARENTS[name]
        place = units[name] - (units[parent] if parent else 0)
        columns.append(np.c_[place, np.zeros((len(place), 3))])
        lines.append(f"{pad}{'JOINT' if parent else 'ROOT'} {rename.get(name, name)}")
        offset = " ".join(f"{v:.6f}" for v in place[0])
        lines.extend([f"{pad}{{", f"{pad}  OFFSET {offset}"])
        lines.append(
            f"{pad}  CHANNELS 6 Xposition Yposition Zposition "
            "Zrotation Xrotation Yrotation"
        )
        children = [child for child, p in PARENTS.items() if p == name]
        for child in children:
            add(child, depth + 1)
        if not children:
            lines.extend([f"{pad}  End Site", f"{pad}  {{", f"{pad}    OFFSET 0 0 0"])
            lines.append(f"{pad}  }}")
        lines.append(f"{pad}}}")

    add("hip", 0)
    data = np.concatenate(columns, axis=1)
    lines += ["MOTION", f"Frames: {len(data)}", f"Frame Time: {1 / rate:.8f}"]
    lines += [" ".join(f"{v:.6f}" for v in row) for row in data]
    Path(path).write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path
