"""From a file to a motion: read, name, measure, mend, place, wrap in capsules."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from handover.human.anthropometry import HEIGHTS
from handover.human.body import ARM, COLUMN, JOINTS, SIDES, BodySizes, UpperBody
from roadmap.ranges import check_path, is_between, settings_of, told
from roadmap.transforms import moved_points
from sim.people.mocap.axes import floor_height, metres_per_unit, up_axis, z_up
from sim.people.mocap.bvh import parse_bvh
from sim.people.mocap.defects import defects, odd_lengths
from sim.people.mocap.faults import Faults, fastest, find_faults, first_frame
from sim.people.mocap.mocap_motion import MocapMotion
from sim.people.mocap.placing import base_from_recording
from sim.people.mocap.skeletons import (
    FEET,
    PLUG_IN_GAIT,
    TOES,
    joint_mapping,
    joints_of,
    pelvis_of,
)
from sim.people.mocap.tracks import BadMocap, Tracks, read_text
from sim.people.mocap.unseen import (
    WALKING,
    bridge,
    displacement,
    growth,
    remember,
    smooth,
)
from sim.people.mocap.vicon import HEADER, parse_csv

ENOUGH_HZ = 100.0  # a faster recording is thinned to this or just above
_HIGHEST = 100.0  # [m] that a floor or a base is from where heights are measured
_FARTHEST = 1e6  # [m] or [rad] of where a person stands


@dataclass(frozen=True)
class MocapSettings:
    """How a recording is read and placed; None: guessed by rule, and said in `notes`.

    Attributes:
        unit: Length of the file's unit: "m", "cm", "mm", "inch" or metres.
        up: Axis that points up: "x", "y", "z", "-x", "-y" or "-z".
        floor: z of the floor in the recording, z up [m].
        stand: (x, y) [m] where the person stands and yaw [rad] they face, base frame.
        base_height: Of the robot's base above the floor [m].
        height: Of the person [m], for what joints do not tell.
        thickness: "conservative" or "mean", of the capsules.
        smooth_s: Window the tracks are averaged over, 0: none [s]. A tracker's
            noise is no speed of the person.
        loop: Play the clip to and fro; else the person stays in the last pose.
        accept_defects: Play even what no person does; it is said in `notes`.
    """

    unit: str | float | None = None
    up: str | None = None
    floor: float | None = None
    stand: tuple[float, float, float] | None = None
    base_height: float = 0.75
    height: float = 1.75
    thickness: str = "conservative"
    smooth_s: float = 0.05
    loop: bool = True
    accept_defects: bool = False

    def __post_init__(self) -> None:
        floor = 0.0 if self.floor is None else self.floor
        numbers = {"base_height": self.base_height, "floor": floor}
        for name, value in numbers.items():
            if not is_between(value, -_HIGHEST, _HIGHEST):
                raise BadMocap(f"{name} is {told(value)} m; give metres from the floor")
        if not is_between(self.height, *HEIGHTS):
            raise BadMocap(
                f"a height of {told(self.height)} m is outside {HEIGHTS[0]} to "
                f"{HEIGHTS[1]} m; give that of an adult"
            )
        if not is_between(self.smooth_s, 0.0, 0.5):
            raise BadMocap(
                f"smooth_s is {told(self.smooth_s)} s; give 0 to 0.5, or fast hands "
                "get lost"
            )
        stand = self.stand
        if stand is not None and not _is_place(stand):
            raise BadMocap(f"stand is {told(stand)}; give x [m], y [m] and yaw [rad]")
        for name in ("loop", "accept_defects"):
            value = getattr(self, name)
            if not isinstance(value, bool | np.bool_):
                raise BadMocap(f"{name} is {told(value)}; give True or False")


def _is_place(stand: object) -> bool:
    """Whether it is two coordinates [m] and an angle [rad]."""
    sound = isinstance(stand, Sequence) or isinstance(stand, np.ndarray) and stand.ndim
    if not sound or len(stand) != 3:  # type: ignore[arg-type]
        return False
    return all(is_between(x, -_FARTHEST, _FARTHEST) for x in stand)


def read_tracks(path: str | Path) -> Tracks:
    """Read a Vicon .csv or a .bvh, told apart by what is in it."""
    path = check_path("path", path, "give that of a .csv or a .bvh")
    text = read_text(path)
    first = next(iter(text.lstrip().splitlines()), "").strip()
    if first.upper().startswith("HIERARCHY"):
        return parse_bvh(text.lstrip(), path.name)
    if first.split(",")[0].strip(' "') in HEADER:
        return parse_csv(text, path.name)
    raise BadMocap(
        f"{path.name} begins with {first[:40]!r}; a .bvh begins with HIERARCHY, a Vicon"
        f" .csv with {', '.join(HEADER)}"
    )


def load_mocap(
    path: str | Path,
    *,
    mapping: str | Path | Mapping[str, str] | None = None,
    settings: MocapSettings | None = None,
) -> MocapMotion:
    """Return a recorded person as a motion in the robot's base frame.

    Args:
        path: A Vicon .csv of tracks, or a .bvh.
        mapping: Joint -> name in the file, or a TOML file of it; None: built-in lists.
            Its `unit` and `up`, if it has them, count before those of the file.
        settings: Units, axes, place, what to do at the end.

    Raises:
        BadMocap: The file, the mapping or a setting cannot be used, the skeleton has
            no arms, an arm is never seen, or no person moves like that.
    """
    settings = settings_of(settings, MocapSettings)
    tracks = read_tracks(path)
    joints, rate, notes = _measured(tracks, mapping, settings)
    joints, faults, mended = _mended(joints, rate, tracks.source)
    notes += mended
    duration_s = (len(next(iter(joints.values()))) - 1) / rate
    odd, wrong = odd_lengths(joints), defects(joints, faults, duration_s)
    if not settings.accept_defects:
        _refuse(tracks.source, odd, wrong)
    notes += [f"no person does this: {clause}" for clause in (*odd, *wrong)]
    floor, said = settings.floor, "as given"
    if floor is None:
        floor, said = floor_height(joints, settings.height)
    notes.append(f"floor at z = {floor:.2f} m of the recording, {said}")
    joints = {
        joint: smooth(bridge(place, rate), rate, settings.smooth_s)
        for joint, place in joints.items()
    }
    T = base_from_recording(joints, settings.stand, floor, settings.base_height)
    return _motion(tracks.source, joints, faults, rate, T, settings, notes)


def _refuse(source: str, odd: Sequence[str], wrong: Sequence[str]) -> None:
    """Refuse a recording of what no person is or does."""
    remedy = "or play it all the same with --accept-defects"
    if wrong:
        raise BadMocap(
            f"{source} shows what no person does: {'; '.join(wrong)}; take the "
            f"measured tracks instead, {remedy}"
        )
    if odd:
        raise BadMocap(
            f"{source} shows a body that no person has: {'; '.join(odd)}; give the "
            f"unit or other names in a mapping (--mapping FILE), {remedy}"
        )


def _measured(
    tracks: Tracks, mapping: object, settings: MocapSettings
) -> tuple[dict[str, np.ndarray], float, list[str]]:
    """Return joint -> (F, 3) places with z up [m], the rate [Hz], and what was said."""
    told = joint_mapping(mapping)
    unit, said_by = told.unit, f"{told.label} says so"
    if settings.unit is not None:
        unit, said_by = settings.unit, "unit of the settings"
    names, label = joints_of(tracks, told.names, told.label)
    places, rest, hip_said = _places(tracks, names, label)
    metres, unit_said = metres_per_unit(tracks, places, unit, said_by if unit else "")
    up = told.up if settings.up is None else settings.up
    up, up_said = up_axis(tracks, places, rest, up)
    stride = max(int(tracks.rate_hz // ENOUGH_HZ), 1)
    rate = tracks.rate_hz / stride
    joints = {j: z_up(p[::stride] * metres, up) for j, p in places.items()}
    notes = [f"{tracks.source}: joints named as by {label}", hip_said]
    notes += [unit_said, up_said]
    if stride > 1:
        notes.append(
            f"thinned from {tracks.rate_hz:g} to {rate:g} frames per second: one in "
            f"{stride} is played"
        )
    return joints, rate, [note for note in notes if note]


def _places(
    tracks: Tracks, names: Mapping[str, str], label: str
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray], str]:
    """Return joint -> (F, 3) places, (1, 3) at rest, and where the hip is from."""
    ends = {toe: f"{names.get(foot)}_end" for foot, toe in zip(FEET, TOES, strict=True)}
    ends = {toe: end for toe, end in ends.items() if end in tracks.places}
    names, said = ends | dict(names), ""
    places = {joint: tracks.places[name] for joint, name in names.items()}
    rest = {j: tracks.rest[n][None] for j, n in names.items() if n in tracks.rest}
    if label == PLUG_IN_GAIT and "hip" not in names:
        hip, markers = pelvis_of(tracks, names)
        if markers:
            places["hip"], said = hip, f"hip taken as the middle of {markers}"
    return places, rest, said


def _mended(
    joints: dict[str, np.ndarray], rate: float, source: str
) -> tuple[dict[str, np.ndarray], dict[str, Faults], list[str]]:
    """Return the joints without what is not believed, the faults, and what was said."""
    notes, faults = [], {}
    body = {joint: place for joint, place in joints.items() if joint in JOINTS}
    start = first_frame(body, rate)
    if start:
        notes.append(f"the first {start} frames skipped: a T-pose or a jump")
    joints = {joint: place[start:].copy() for joint, place in joints.items()}
    n_frames = len(next(iter(joints.values())))
    if n_frames < 2:
        raise BadMocap(
            f"{source} holds nothing but a jump at its start; record for longer"
        )
    for joint in body:
        place, words = joints[joint], joint.replace("_", " ")
        fault = faults[joint] = find_faults(place, rate, fastest(joint))
        gap = ~np.isfinite(place).all(axis=1)
        place[gap | fault.bad] = np.nan
        if fault.jumps:
            notes.append(
                f"{words}: {fault.jumps} jumps of up to {fault.peak:.1f} m/s are no "
                f"motion, {fault.bad.sum()} frames not believed"
            )
        if gap.any():
            notes.append(f"{words}: not seen in {gap.sum()} of {n_frames} frames")
        if (gap | fault.bad).all():
            del joints[joint]
    whole = [s for s in SIDES if all(f"{s}_{j}" in joints for j in ARM)]
    if not whole:
        lost = sorted(f.replace("_", " ") for f in body if f not in joints)
        raise BadMocap(
            f"no arm is ever seen in {source}: {', '.join(lost)} in none of "
            f"{n_frames} frames; check the tracker, or map other bodies"
        )
    notes += [f"no {side} arm" for side in SIDES if side not in whole]
    return joints, faults, notes


def _motion(
    source: str,
    joints: dict[str, np.ndarray],
    faults: dict[str, Faults],
    rate: float,
    T: np.ndarray,
    settings: MocapSettings,
    notes: list[str],
) -> MocapMotion:
    n_frames = len(next(iter(joints.values())))
    order = np.arange(n_frames)
    if settings.loop:
        order = np.r_[order, order[-2:0:-1]]
    present = [joint for joint in JOINTS if joint in joints]
    body = UpperBody(present, BodySizes.sized(settings.height, settings.thickness))
    shape = (len(order), len(JOINTS))
    places, guesses, age = np.zeros((*shape, 3)), np.zeros((*shape, 3)), np.zeros(shape)
    jumped = np.zeros(shape, bool)
    for joint in present:
        place = moved_points(joints[joint][order], T)
        k = COLUMN[joint]
        known = remember(place, rate, settings.loop)
        places[:, k], guesses[:, k], age[:, k] = known
        jumped[:, k] = faults[joint].bad[order]
    frames = body.capsules(places)
    oldest = np.where(body.needs, age[:, None, :], 0.0).max(axis=2)
    moved = displacement(frames, settings.loop)
    speed = max(WALKING, _fastest_seen(moved, oldest, rate))
    grown = growth(oldest, moved, rate, speed)
    frames[:, :, 6] += grown
    after = np.roll(grown, -1, axis=0)[: len(moved)]
    advance = (moved + after - grown[: len(moved)]).max() * rate
    return MocapMotion(
        source, max(float(advance), 0.0), rate, (n_frames - 1) / rate, settings.loop,
        frames, body.capsules(guesses), body.labels, age, jumped, tuple(notes),
    )  # fmt: skip


def _fastest_seen(moved: np.ndarray, oldest: np.ndarray, rate: float) -> float:
    """Return the highest speed of capsules that are seen before and after [m/s]."""
    after = np.roll(oldest, -1, axis=0)[: len(moved)]
    both = (oldest[: len(moved)] == 0) & (after == 0)
    return float(np.where(both, moved, 0.0).max() * rate)
