"""Which name of a recording is which joint: built-in lists and small TOML files."""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from handover.human.body import ARM, JOINTS, SIDES
from roadmap.ranges import check_path
from sim.people.mocap.subjects import Roll, split
from sim.people.mocap.tracks import BadMocap, Tracks

FEET = ("left_foot", "right_foot")  # only to find the floor, and what is up
TOES = ("left_toe", "right_toe")  # only to tell a mirrored person
KNOWN = (*JOINTS, *FEET, *TOES)
PLUG_IN_GAIT = "Vicon Plug-in Gait"
PELVIS = ("LPSI", "RPSI", "LASI", "RASI")  # its markers where there is no SACR
_LIMBS = (*ARM, "foot", "toe", "tip")
_MAPPING = "give the path of a TOML file, or joint -> name"


def _names(sides: str, trunk: str, limbs: str) -> dict[str, str]:
    """Return joint -> name from 'left right', 'hip|neck|head' and names of `_LIMBS`.

    {s} in a name stands for what its side is called; the last ones may be missing.
    """
    return dict(zip(("hip", "neck", "head"), trunk.split("|"), strict=True)) | {
        f"{side}_{joint}": name.format(s=called)
        for side, called in zip(SIDES, sides.split(), strict=True)
        for joint, name in zip(_LIMBS, limbs.split("|"), strict=False)
    }


BUILT_IN = {
    "Vicon tracks": _names(
        "left right", "hip|collar|head", "{s}_shoulder|{s}_elbow|{s}_hand"
    ),
    "CMU (cgspeed, Daz)": _names(
        "l r", "hip|neck|head", "{s}Shldr|{s}ForeArm|{s}Hand|{s}Foot"
    ),
    "human-robot-animations": _names(
        "left right", "hip|neck|head", "{s}_upper_arm|{s}_forearm|{s}_hand"
    ),
    "Mixamo, MotionBuilder": _names(
        "Left Right",
        "Hips|Neck|Head",
        "{s}Arm|{s}ForeArm|{s}Hand|{s}Foot|{s}ToeBase|{s}HandMiddle4",
    ),
    "Xsens, Poser": _names(
        "Left Right", "Hips|Neck|Head", "{s}Shoulder|{s}Elbow|{s}Wrist|{s}Ankle|{s}Toe"
    ),
    "Xsens MVN": _names(
        "Left Right",
        "Pelvis|Neck|Head",
        "{s}UpperArm|{s}ForeArm|{s}Hand|{s}Foot|{s}Toe",
    ),
    "3ds Max Biped": _names(
        "L R",
        "Bip01 Pelvis|Bip01 Neck|Bip01 Head",
        "Bip01 {s} UpperArm|Bip01 {s} Forearm|Bip01 {s} Hand|"
        "Bip01 {s} Foot|Bip01 {s} Toe0",
    ),
    "Blender Rigify": _names(
        "L R",
        "spine|spine.004|spine.006",
        "upper_arm.{s}|forearm.{s}|hand.{s}|foot.{s}|toe.{s}",
    ),
    "SMPL": _names(
        "left right",
        "pelvis|neck|head",
        "{s}_shoulder|{s}_elbow|{s}_wrist|{s}_ankle|{s}_foot",
    ),
    PLUG_IN_GAIT: _names(
        "L R", "SACR|C7|LFHD", "{s}SHO|{s}ELB|{s}WRA|{s}ANK|{s}TOE|{s}FIN"
    ),
    "VRM": _names(
        "L R",
        "J_Bip_C_Hips|J_Bip_C_Neck|J_Bip_C_Head",
        "J_Bip_{s}_UpperArm|J_Bip_{s}_LowerArm|J_Bip_{s}_Hand|"
        "J_Bip_{s}_Foot|J_Bip_{s}_ToeBase",
    ),
    "Unreal": _names(
        "l r",
        "pelvis|neck_01|head",
        "upperarm_{s}|lowerarm_{s}|hand_{s}|foot_{s}|ball_{s}",
    ),
}


def joints_of(
    tracks: Tracks,
    mapping: str | Path | Mapping[str, str] | None = None,
    label: str = "the mapping",
) -> tuple[dict[str, str], str]:
    """Return joint -> name as the recording spells it, and what the mapping is called.

    Joints are those of `handover.human.body.JOINTS`, a foot or a toe. `mapping` is
    joint -> name, or a TOML file that holds it; None takes the built-in list that fits
    best. Names are compared without case; a namespace (`mixamorig:`, `Eve:`) may be
    left out where it tells nothing.

    Raises:
        BadMocap: The mapping is unreadable, names an unknown joint or one that the
            recording lacks; no arm is found; or it is not said whose.
    """
    roll = Roll(tracks.source, tracks.places)
    if mapping is None:
        return _best(tracks, roll)
    if not isinstance(mapping, Mapping):
        label = check_path("the mapping", mapping, _MAPPING).name
        mapping = read_mapping(mapping)
    _check(mapping, label)
    absent = [f"{n!r} ({j})" for j, n in mapping.items() if not roll.find(n)]
    if absent:
        raise BadMocap(
            f"{label} names {', '.join(absent)}, which {tracks.source} lacks; it holds "
            f"{_listed(tracks)}"
        )
    if not _arms(mapping):
        raise BadMocap(
            f"{label} names no whole arm; give shoulder, elbow and hand of at least "
            f"one side, as right_shoulder, right_elbow, right_hand"
        )
    names = roll.resolve(mapping, label)
    _check_once(names, mapping, label)
    return names, label


def pelvis_of(tracks: Tracks, names: Mapping[str, str]) -> tuple[np.ndarray, str]:
    """Return the (F, 3) middle of a Plug-in Gait pelvis' markers, and their names.

    Markers that are seen in less than half of the frames are left out.
    """
    whose = {split(name)[0] for name in names.values()}
    found = {}
    for name, place in tracks.places.items():
        subject, plain = split(name)
        if subject in whose and plain.upper() in PELVIS:
            if np.isfinite(place).all(axis=1).mean() >= 0.5:
                found[name] = place
    if not found:
        return np.full((tracks.n_frames, 3), np.nan), ""
    return np.mean(list(found.values()), axis=0), ", ".join(found)


def read_mapping(path: str | Path) -> dict[str, str]:
    """Return joint -> name from a TOML file of lines like `right_hand = "rHand"`."""
    path = check_path("the mapping", path, _MAPPING)
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise BadMocap(f"the mapping {path} cannot be read: {error.strerror}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise BadMocap(
            f"the mapping {path.name} is no TOML ({error}); write lines like "
            'right_hand = "rHand"'
        ) from None


@dataclass(frozen=True)
class JointMapping:
    """What a mapping tells of a recording."""

    # joint -> name in the recording; None: the built-in lists are looked at
    names: Mapping[str, str] | None = None
    unit: str | float | None = None  # by name or in metres, None where it is not said
    up: str | None = None  # axis that points up, None where it is not said
    label: str = ""  # what the mapping is called; a file has its name


def joint_mapping(mapping: str | Path | Mapping[str, object] | None) -> JointMapping:
    """Return what a mapping tells; one of `unit` and `up` alone names no joints."""
    if mapping is None:
        return JointMapping()
    label = "the mapping"
    if not isinstance(mapping, Mapping):
        label = check_path("the mapping", mapping, _MAPPING).name
        mapping = read_mapping(mapping)
    unit, up = mapping.get("unit"), mapping.get("up")
    wrong = isinstance(unit, bool) or not isinstance(unit, str | float | int | None)
    if wrong:
        raise BadMocap(
            f'{label} gives unit = {unit!r}; give a name in quotes, as "cm", or the '
            "metres of a unit"
        )
    names = {joint: n for joint, n in mapping.items() if joint not in ("unit", "up")}
    return JointMapping(names if names or not mapping else None, unit, up, label)


def _check(mapping: Mapping[str, str], label: str) -> None:
    unknown = [str(joint) for joint in mapping if joint not in KNOWN]
    if unknown:
        raise BadMocap(
            f"{label} maps {', '.join(unknown)}; joints are {', '.join(KNOWN)}"
        )
    wrong = [joint for joint, name in mapping.items() if not isinstance(name, str)]
    if wrong:
        raise BadMocap(
            f"{label} gives {wrong[0]} = {mapping[wrong[0]]!r}; give a name in quotes"
        )


def _check_once(
    names: Mapping[str, str], mapping: Mapping[str, str], label: str
) -> None:
    """Refuse a mapping that names one body for two joints."""
    first: dict[str, str] = {}
    for joint, name in names.items():
        other = first.setdefault(name, joint)
        if other != joint:
            raise BadMocap(
                f"{label} gives {mapping[joint]!r} for {other} and for {joint}, so a "
                "part of the person would be where it is not; give each joint its own"
            )


def _best(tracks: Tracks, roll: Roll) -> tuple[dict[str, str], str]:
    """Return the built-in names of the only person in the recording, and their list."""
    *people, loose = [_fitting(bodies) for bodies in roll.groups()]
    found = {_bodies(best): (best, label) for best, label in people if label}
    sides = {side for best, _ in found.values() for side in _arms(best)}
    nobodys = set(_arms(loose[0]))  # of one person with a name, where no arm is twice
    if nobodys and (not found or nobodys & sides):
        found.setdefault(_bodies(loose[0]), loose)
    if not found:
        raise BadMocap(
            f"no arm is known in {tracks.source}, which holds {_listed(tracks)}; write "
            "a mapping file with lines such as "
            'right_shoulder = "...", right_elbow = "...", right_hand = "..." and give '
            "it as mapping (--mapping FILE)"
        )
    if len(found) > 1:
        _refuse_several(tracks.source, roll, found)
    return next(iter(found.values()))


def _refuse_several(
    source: str, roll: Roll, found: Mapping[tuple[str, ...], tuple[dict, str]]
) -> None:
    whose = roll.of(name for bodies in found for name in bodies)
    others = "" if len(whose) == len(found) else " and one without a name"
    last, _ = list(found.values())[len(whose) - 1]
    side = _arms(last)[-1]
    lines = ", ".join(f'{side}_{j} = "{last[f"{side}_{j}"]}"' for j in ARM)
    raise BadMocap(
        f"{source} holds the arms of {' and '.join(whose)}{others}; say whose to take "
        f"in a mapping (--mapping FILE), as {lines}"
    )


def _bodies(names: Mapping[str, str]) -> tuple[str, ...]:
    """Return the bodies of the arms: those of one person are no one else's."""
    return tuple(names[f"{s}_{j}"] for s in _arms(names) for j in ARM)


def _fitting(bodies: Mapping[str, str]) -> tuple[dict[str, str], str]:
    """Return the names of the built-in list with most of them, and it; none, ""."""
    best: dict[str, str] = {}
    label = ""
    for name, mapping in BUILT_IN.items():
        plain = {joint: split(n)[1] for joint, n in mapping.items()}
        here = {joint: bodies[n] for joint, n in plain.items() if n in bodies}
        if _arms(here) and len(here) > len(best):
            best, label = here, name
    return best, label


def _arms(joints: Mapping[str, object]) -> list[str]:
    return [s for s in SIDES if all(f"{s}_{j}" in joints for j in ARM)]


def _listed(tracks: Tracks) -> str:
    names = [name for name in tracks.places if not name.endswith("_end")]
    more = f" and {len(names) - 40} more" if len(names) > 40 else ""
    return ", ".join(names[:40]) + more
