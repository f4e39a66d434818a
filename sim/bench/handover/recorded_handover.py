"""A recorded hand-over of two people: skeletons, object and grip forces, as files.

A folder of one hand-over of the Handovers@RPL data set [Khanna2023]: for giver and
taker `<who>_<part>_pose*.csv` (x, y, z in m, quaternion x, y, z, w) at 120 Hz, the
object's `baton_pose*.csv`, and `Wrench_giver*.csv`, `Wrench_taker*.csv` (the grip force
is -Fz). A part's place is the near end of its bone; z is up.
"""

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from handover import Human, human_from_joints
from handover.human.body import SIDES
from roadmap.errors import BadInput

GRIP_N = 1.0  # a hand that presses harder holds the object [N]
_POSE = ("x", "y", "z", "q0", "q1", "q2", "q3")
_LETTER = {"left": "L", "right": "R"}
_UPPER, _FORE, _HAND = "UArm", "FArm", "Hand"
_TRUNK = {"hip": "hip", "neck": "neck", "head": "head"}


@dataclass(frozen=True, eq=False)
class HandoverRecording:
    """One hand-over.

    Attributes:
        name: Of its folder.
        poses: "<who> <part>" or "object" -> (n, 4, 4) [m].
        taken: Frame in which the taker grips.
        released: Frame in which the giver lets go.
        notes: What was found out or mended.
    """

    name: str
    poses: dict[str, np.ndarray]
    taken: int
    released: int
    notes: tuple[str, ...] = ()

    @property
    def frames(self) -> int:
        """Number of frames, at 120 Hz."""
        return len(self.poses["object"])

    def place(self, who: str, part: str) -> np.ndarray:
        """Return the (n, 3) places of a part of "giver" or "taker" [m]."""
        return self.poses[f"{who} {part}"][:, :3, 3]

    def hand(self, who: str) -> str:
        """Return with which hand somebody holds the object: the nearer elbow's."""
        at = self.poses["object"][self.taken, :3, 3]
        far = [
            np.linalg.norm(self.place(who, _LETTER[s] + _FORE)[self.taken] - at)
            for s in SIDES
        ]
        return SIDES[int(np.argmin(far))]

    def wrist(self, who: str, side: str, frame: int) -> np.ndarray:
        """Return the place of a wrist, (3,) [m].

        Where its own track is missing it follows from the pose of the forearm, whose
        bone lies along the axis that the upper arm's does, as long as the other one.
        """
        letter = _LETTER[side]
        key = f"{who} {letter}{_HAND}"
        if key in self.poses:
            return self.poses[key][frame, :3, 3]
        upper, fore = (self.poses[f"{who} {letter}{p}"] for p in (_UPPER, _FORE))
        local = np.einsum("nji,nj->ni", upper[:, :3, :3], (fore - upper)[:, :3, 3])
        along = np.median(local, axis=0)
        length = self._forearm(who)
        elbow = fore[frame]
        return elbow[:3, 3] + length * elbow[:3, :3] @ (along / np.linalg.norm(along))

    def gaze(self, who: str, frame: int) -> np.ndarray:
        """Return the direction of the head, (3,).

        Of the six axes of the head's frame, the one that points to the front of the
        shoulders most, on average over the recording.
        """
        left, right = (self.place(who, _LETTER[s] + _UPPER) for s in SIDES)
        front = np.cross(left - right, [0.0, 0.0, 1.0])
        front /= np.linalg.norm(front, axis=1, keepdims=True)
        turns = self.poses[f"{who} head"][:, :3, :3]
        along = np.einsum("nij,ni->j", turns, front)
        k = int(np.abs(along).argmax())
        return np.sign(along[k]) * turns[frame, :, k]

    def person(self, who: str, frame: int, look: bool = True) -> Human:
        """Return the model fitted to somebody's measured joints.

        Args:
            who: "giver" or "taker".
            frame: When.
            look: Whether the gaze is the head's; else it is not known.
        """
        places = {joint: self.place(who, p)[frame] for p, joint in _TRUNK.items()}
        for side in SIDES:
            letter = _LETTER[side]
            places[f"{side}_shoulder"] = self.place(who, letter + _UPPER)[frame]
            places[f"{side}_elbow"] = self.place(who, letter + _FORE)[frame]
            places[f"{side}_hand"] = self.wrist(who, side, frame)
        gaze = self.gaze(who, frame) if look else None
        return human_from_joints(places, gaze=gaze, thickness="mean")

    def _forearm(self, who: str) -> float:
        """Return the length of a forearm whose wrist was measured [m]."""
        for letter in _LETTER.values():
            if f"{who} {letter}{_HAND}" in self.poses:
                bone = self.place(who, letter + _HAND) - self.place(who, letter + _FORE)
                return float(np.median(np.linalg.norm(bone, axis=1)))
        raise BadInput(
            f"{self.name} has no track of a hand of the {who}; give LHand or RHand"
        )


def read_handover(folder: str | Path) -> HandoverRecording:
    """Read a folder of one hand-over.

    A hand's track that is that of the other hand, a known defect of the data, is left
    out and told in the notes.

    Raises:
        BadInput: Files are missing or cut off, hold no finite numbers, or nobody takes
            anything.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise BadInput(f"{folder} is no folder; give that of one recorded hand-over")
    poses = {"object": _poses(_file(folder, "baton_pose"))}
    arms = [_LETTER[s] + part for s in SIDES for part in (_UPPER, _FORE)]
    for who in ("giver", "taker"):
        for part in (*_TRUNK, *arms):
            poses[f"{who} {part}"] = _poses(_file(folder, f"{who}_{part}_pose"))
        for letter in _LETTER.values():
            found = sorted(folder.glob(f"{who}_{letter}{_HAND}_pose*.csv"))
            if found:
                poses[f"{who} {letter}{_HAND}"] = _poses(found[0])
    notes = _drop_copies(poses)
    grips = [
        -_numbers(_file(folder, f"Wrench_{who}"), ("Fz",))[:, 0]
        for who in ("giver", "taker")
    ]
    lengths = {len(a) for a in (*poses.values(), *grips)}
    if len(lengths) != 1:
        raise BadInput(
            f"the files of {folder} have {', '.join(map(str, sorted(lengths)))} rows; "
            "all must have the same frames"
        )
    taken, released = _transfer(*grips, str(folder))
    return HandoverRecording(folder.name, poses, taken, released, tuple(notes))


def _transfer(giver: np.ndarray, taker: np.ndarray, name: str) -> tuple[int, int]:
    """Return the frames in which the taker grips and the giver has let go.

    The taker's grip is the first that leads to the strongest one; the giver lets go
    when no longer gripping after that.
    """
    strongest = int(taker.argmax())
    loose = np.flatnonzero(taker[: strongest + 1] <= GRIP_N)
    taken = int(loose[-1]) + 1 if len(loose) else 0
    after = np.flatnonzero(giver[taken:] < GRIP_N)
    if taker[strongest] <= GRIP_N or not len(after) or taken == 0:
        raise BadInput(
            f"in {name} nobody takes the object while the giver lets go (grip above "
            f"{GRIP_N:g} N); give a recording of a hand-over"
        )
    return taken, taken + int(after[0])


def _drop_copies(poses: dict[str, np.ndarray]) -> list[str]:
    notes = []
    for who in ("giver", "taker"):
        left, right = (f"{who} {_LETTER[s]}{_HAND}" for s in SIDES)
        both = left in poses and right in poses
        if both and np.abs(poses[left] - poses[right]).max() < 1e-6:
            at = poses[left][:, :3, 3]
            far = {
                key: np.linalg.norm(at - poses[fore][:, :3, 3], axis=1)
                for key, fore in ((left, f"{who} LFArm"), (right, f"{who} RFArm"))
            }
            wrong = max(far, key=lambda key: float(far[key].std()))
            del poses[wrong]
            notes.append(f"the track of {wrong} is that of the other hand: left out")
    return notes


def _file(folder: Path, stem: str) -> Path:
    found = sorted(folder.glob(f"{stem}*.csv"))
    if not found:
        raise BadInput(
            f"{folder} has no {stem}*.csv; a hand-over has baton_pose, Wrench_giver, "
            "Wrench_taker, and the poses of giver and taker"
        )
    return found[0]


def _poses(path: Path) -> np.ndarray:
    """Return (n, 4, 4) of a file of places and quaternions x, y, z, w."""
    rows = _numbers(path, _POSE)
    length = np.linalg.norm(rows[:, 3:], axis=1, keepdims=True)
    if not (np.abs(length - 1.0) < 1e-2).all():
        raise BadInput(f"{path.name} holds quaternions that are not of length 1")
    x, y, z, w = (rows[:, 3:] / length).T
    turns = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    T = np.zeros((len(rows), 4, 4))
    T[:, :3, :3] = np.moveaxis(np.array(turns), 2, 0)
    T[:, :3, 3], T[:, 3, 3] = rows[:, :3], 1.0
    return T


def _numbers(path: Path, columns: tuple[str, ...]) -> np.ndarray:
    """Return the named columns of a .csv, (n, k)."""
    with open(path, newline="", encoding="utf-8", errors="replace") as stream:
        head, *rows = list(csv.reader(stream)) or [[]]
    names = [name.strip() for name in head]
    missing = [name for name in columns if name not in names]
    if missing:
        raise BadInput(
            f"{path.name} has no column {', '.join(missing)}; its first line must name "
            f"{', '.join(columns)}"
        )
    rows = [row for row in rows if row]
    try:
        data = np.array([[float(row[names.index(c)]) for c in columns] for row in rows])
    except (ValueError, IndexError):
        data = np.full((1, 1), np.nan)
    if len(data) < 2 or not np.isfinite(data).all():
        raise BadInput(
            f"{path.name} is cut off or holds what is no number; give at least two "
            "whole rows"
        )
    return data
