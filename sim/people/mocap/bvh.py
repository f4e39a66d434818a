"""BVH files: a skeleton, and over time the angles of its joints."""

from dataclasses import dataclass, field

import numpy as np

from sim.people.mocap.tracks import BadMocap, Tracks, number

_AXES = {"X": 0, "Y": 1, "Z": 2}


@dataclass
class _Joint:
    """A joint while the file is read."""

    name: str
    parent: int
    offset: np.ndarray = field(default_factory=lambda: np.zeros(3))
    channels: list[tuple[str, int]] = field(default_factory=list)  # kind, axis
    first: int = 0  # column of its first channel


def parse_bvh(text: str, source: str) -> Tracks:
    """Return the places of all joints, in the file's units and axes.

    A joint may list its channels in any order; rotations act one after the other
    about the axes already turned (intrinsic), in degrees. A position channel takes
    the place of that coordinate of the offset. The end of a chain is named
    `<joint>_end`.

    Raises:
        BadMocap: Not a BVH, cut off, not numeric, a rate of 0, no frames.
    """
    lines = text.replace("{", "\n{\n").replace("}", "\n}\n").splitlines()
    lines = [line.strip() for line in lines if line.strip()]
    upper = [line.upper() for line in lines]
    if "MOTION" not in upper:
        raise BadMocap(f"{source} has no line MOTION: the file is cut off, or no BVH")
    at = upper.index("MOTION")
    joints = _hierarchy(lines[1:at], source)
    n_channels = sum(len(joint.channels) for joint in joints)
    count, rate, start = _motion_header(lines, at, source)
    values = _values(lines[start:], n_channels, count, source)
    with np.errstate(over="ignore", invalid="ignore"):  # too far: not seen
        places = _places(joints, values)
    still = [_Joint(one.name, one.parent, one.offset) for one in joints]
    rest = {name: at[0] for name, at in _places(still, values[:1]).items()}
    return Tracks(source, rate, places, rest=rest)


def _hierarchy(lines: list[str], source: str) -> list[_Joint]:
    joints: list[_Joint] = []
    open_joints: list[int] = []
    whose: dict[str, int] = {}  # name -> number of its skeleton
    n_channels = n_roots = 0
    for line in lines:
        word, _, rest = line.partition(" ") if " " in line else line.partition("\t")
        word, rest = word.upper(), rest.strip()
        if word in ("ROOT", "JOINT", "END"):
            parent = open_joints[-1] if open_joints else -1
            name = f"{joints[parent].name}_end" if word == "END" else rest
            n_roots += word == "ROOT"
            if whose.setdefault(name, n_roots) != n_roots:
                raise BadMocap(
                    f"{source} holds two skeletons that have a joint {name!r}, and "
                    "nothing tells which is whose; keep one of them in the file, or "
                    f"write whose they are, as Eve:{name}"
                )
            joints.append(_Joint(name, parent))
        elif word == "{" and joints:
            open_joints.append(len(joints) - 1)
        elif word == "}" and open_joints:
            open_joints.pop()
        elif word == "OFFSET" and joints:
            joints[-1].offset = _offset(rest, joints[-1].name, source)
        elif word == "CHANNELS" and joints:
            joints[-1].channels = _channels(rest, joints[-1], source)
            joints[-1].first = n_channels
            n_channels += len(joints[-1].channels)
        else:
            raise BadMocap(
                f"{source} has the line {line[:40]!r} in its skeleton, where a BVH has "
                "ROOT, JOINT, OFFSET, CHANNELS, End Site or a brace"
            )
    if open_joints or not joints:
        raise BadMocap(f"the skeleton of {source} is not complete: the file is cut off")
    return joints


def _offset(text: str, joint: str, source: str) -> np.ndarray:
    what = f"the OFFSET of {joint} in {source}"
    values = [number(word, what) for word in text.split()]
    if len(values) != 3 or not np.isfinite(values).all():
        raise BadMocap(f"{what} is {text[:40]!r}; it must be three numbers")
    return np.array(values)


def _channels(text: str, joint: _Joint, source: str) -> list[tuple[str, int]]:
    count, *names = text.split() or ["0"]
    if joint.channels:
        raise BadMocap(
            f"joint {joint.name} of {source} has two lines CHANNELS; leave one of both"
        )
    found = []
    for name in names:
        axis, kind = name[:1].upper(), name[1:].lower()
        if axis not in _AXES or kind not in ("position", "rotation"):
            raise BadMocap(
                f"joint {joint.name} of {source} has a channel {name!r}; a BVH knows "
                "Xposition .. Zposition and Xrotation .. Zrotation"
            )
        found.append((kind, _AXES[axis]))
    what = f"the number of channels of {joint.name} in {source}"
    if number(count, what) != len(found):
        raise BadMocap(
            f"joint {joint.name} of {source} announces {count} channels and lists "
            f"{len(found)}; correct its line CHANNELS"
        )
    return found


def _motion_header(lines: list[str], at: int, source: str) -> tuple[int, float, int]:
    """Return the number of frames, the rate [Hz], and the line the data start at."""
    found = {}
    for i, line in enumerate(lines[at + 1 : at + 3]):
        key, colon, value = line.partition(":")
        if colon:
            key = key.strip().lower()
            found[key] = number(value, f"{key!r} of {source}")
            start = at + 2 + i
    missing = [key for key in ("frames", "frame time") if key not in found]
    if missing:
        raise BadMocap(
            f"{source} does not give {' and '.join(repr(k) for k in missing)} after "
            "MOTION: the file is cut off; get the whole of it"
        )
    period, count = found["frame time"], found["frames"]
    if not 0 < period < np.inf:
        raise BadMocap(
            f"{source} gives a frame time of {period:g} s, so no rate; correct it, "
            "as 0.01 for 100 frames per second"
        )
    if not count >= 1 or not float(count).is_integer():
        raise BadMocap(f"{source} says it holds {count:g} frames; record again")
    return int(count), 1.0 / period, start


def _values(lines: list[str], width: int, count: int, source: str) -> np.ndarray:
    """Return the (frames, channels) numbers."""
    words = " ".join(lines).split()
    if width == 0:
        raise BadMocap(f"no joint of {source} has channels, so nothing moves in it")
    try:
        values = np.array(words, dtype=np.float64)
    except ValueError:
        for word in words:
            number(word, f"a value after MOTION in {source}")
        raise
    if values.size != count * width:
        whole, more = divmod(values.size, width)
        odd = f" and {more} values of another" if more else ""
        raise BadMocap(
            f"{source} says it holds {count} frames of {width} values, but {whole} "
            f"are there{odd}: the file is cut off or altered; get the whole of it"
        )
    return values.reshape(count, width)


def _places(joints: list[_Joint], values: np.ndarray) -> dict[str, np.ndarray]:
    """Return name -> (F, 3): every joint posed from its parent's pose."""
    from scipy.spatial.transform import Rotation  # what plays no file need not load it

    n_frames = len(values)
    turns: list[np.ndarray] = []
    places: list[np.ndarray] = []
    for joint in joints:
        shift = np.tile(joint.offset, (n_frames, 1))
        turn = np.eye(3)[None]
        for k, (kind, axis) in enumerate(joint.channels):
            column = values[:, joint.first + k]
            if kind == "position":
                shift[:, axis] = column
            else:
                angle = Rotation.from_euler("xyz"[axis], column[:, None], True)
                turn = turn @ angle.as_matrix()
        if joint.parent >= 0:
            parent = turns[joint.parent]
            shift = places[joint.parent] + (parent @ shift[:, :, None])[:, :, 0]
            turn = parent @ turn
        places.append(shift)
        turns.append(turn)
    found: dict[str, np.ndarray] = {}
    for joint, place in zip(joints, places, strict=True):
        found.setdefault(joint.name, place)
    return found
