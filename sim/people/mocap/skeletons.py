"""Which name of a recording is which joint: built-in lists and small TOML files."""

import tomllib
from collections.abc import Mapping
from pathlib import Path

from handover.human.body import ARM, JOINTS, SIDES
from sim.people.mocap.tracks import BadMocap, Tracks

FEET = ("left_foot", "right_foot")  # only to find the floor
KNOWN = (*JOINTS, *FEET)


def _both(pattern: dict[str, str], **sides: str) -> dict[str, str]:
    """Return joint -> name for both sides; {s} in a name stands for the side."""
    return {
        f"{side}_{joint}": name.format(s=sides[side])
        for side in SIDES
        for joint, name in pattern.items()
    }


def _names(
    trunk: str, arm: str, foot: str = "", tip: str = "", **sides: str
) -> dict[str, str]:
    """Return a mapping from 'hip neck head', 'shoulder elbow hand', foot and tip."""
    pattern = dict(zip(ARM, arm.split("|"), strict=True))
    pattern |= {k: v for k, v in (("foot", foot), ("tip", tip)) if v}
    mapping = dict(zip(("hip", "neck", "head"), trunk.split("|"), strict=True))
    return mapping | _both(pattern, **sides)


BUILT_IN = {
    "Vicon tracks": _names(
        "hip|collar|head",
        "{s}_shoulder|{s}_elbow|{s}_hand",
        left="left",
        right="right",
    ),
    "CMU (cgspeed, Daz)": _names(
        "hip|neck|head", "{s}Shldr|{s}ForeArm|{s}Hand", "{s}Foot", left="l", right="r"
    ),
    "human-robot-animations": _names(
        "hip|neck|head",
        "{s}_upper_arm|{s}_forearm|{s}_hand",
        left="left",
        right="right",
    ),
    "Mixamo, MotionBuilder": _names(
        "Hips|Neck|Head",
        "{s}Arm|{s}ForeArm|{s}Hand",
        "{s}Foot",
        "{s}HandMiddle4",
        left="Left",
        right="Right",
    ),
    "Xsens, Poser": _names(
        "Hips|Neck|Head",
        "{s}Shoulder|{s}Elbow|{s}Wrist",
        "{s}Ankle",
        left="Left",
        right="Right",
    ),
    "3ds Max Biped": _names(
        "Bip01 Pelvis|Bip01 Neck|Bip01 Head",
        "Bip01 {s} UpperArm|Bip01 {s} Forearm|Bip01 {s} Hand",
        "Bip01 {s} Foot",
        left="L",
        right="R",
    ),
    "SMPL": _names(
        "pelvis|neck|head",
        "{s}_shoulder|{s}_elbow|{s}_wrist",
        "{s}_ankle",
        left="left",
        right="right",
    ),
    "Vicon Plug-in Gait": _names(
        "SACR|C7|LFHD", "{s}SHO|{s}ELB|{s}WRA", "{s}ANK", "{s}FIN", left="L", right="R"
    ),
    "VRM": _names(
        "J_Bip_C_Hips|J_Bip_C_Neck|J_Bip_C_Head",
        "J_Bip_{s}_UpperArm|J_Bip_{s}_LowerArm|J_Bip_{s}_Hand",
        "J_Bip_{s}_Foot",
        left="L",
        right="R",
    ),
    "Unreal": _names(
        "pelvis|neck_01|head",
        "upperarm_{s}|lowerarm_{s}|hand_{s}",
        "foot_{s}",
        left="l",
        right="r",
    ),
}


def joints_of(
    tracks: Tracks,
    mapping: str | Path | Mapping[str, str] | None = None,
    label: str = "the mapping",
) -> tuple[dict[str, str], str]:
    """Return which name of the recording is which joint.

    Args:
        tracks: The recording.
        mapping: Joint -> name in the recording, or a TOML file that holds it; None
            takes the built-in list that fits best. Names are compared without case
            and without a namespace (`mixamorig:`).
        label: What the mapping is called; a file has its name.

    Returns:
        Joint of `handover.human.body.JOINTS`, or a foot -> name as the recording spells
        it; and what the mapping is called.

    Raises:
        BadMocap: The mapping is unreadable, names an unknown joint or one that the
            recording lacks; or no arm is found.
    """
    if mapping is None:
        return _best(tracks)
    if not isinstance(mapping, Mapping):
        label = Path(mapping).name
        mapping = read_mapping(mapping)
    _check(mapping, label)
    names = _simple(tracks)
    absent = [f"{n!r} ({j})" for j, n in mapping.items() if _key(n) not in names]
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
    return {joint: names[_key(name)] for joint, name in mapping.items()}, label


def read_mapping(path: str | Path) -> dict[str, str]:
    """Return joint -> name from a TOML file of lines like `right_hand = "rHand"`.

    Raises:
        BadMocap: The file is missing or no TOML.
    """
    path = Path(path)
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise BadMocap(f"the mapping {path} cannot be read: {error.strerror}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise BadMocap(
            f"the mapping {path.name} is no TOML ({error}); write lines like "
            'right_hand = "rHand"'
        ) from None


def unit_of(
    mapping: str | Path | Mapping[str, object] | None,
) -> tuple[Mapping[str, str] | None, str | float | None, str]:
    """Return a mapping without the `unit` it may state, that unit, and its name.

    A mapping that holds nothing else is none: the built-in lists are looked at.

    Raises:
        BadMocap: The mapping cannot be read, or the unit is neither name nor number.
    """
    if mapping is None:
        return None, None, ""
    label = "the mapping"
    if not isinstance(mapping, Mapping):
        label = Path(mapping).name
        mapping = read_mapping(mapping)
    unit = mapping.get("unit")
    wrong = isinstance(unit, bool) or not isinstance(unit, str | float | int | None)
    if wrong:
        raise BadMocap(
            f'{label} gives unit = {unit!r}; give a name in quotes, as "cm", or the '
            "metres of a unit"
        )
    names = {joint: name for joint, name in mapping.items() if joint != "unit"}
    return names if names or unit is None else None, unit, label


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
    first: dict[str, str] = {}
    for joint, name in mapping.items():
        other = first.setdefault(_key(name), joint)
        if other != joint:
            raise BadMocap(
                f"{label} gives {name!r} for {other} and for {joint}, so a part of the "
                "person would be where it is not; give each joint its own"
            )


def _best(tracks: Tracks) -> tuple[dict[str, str], str]:
    names = _simple(tracks)
    found = {}
    for label, mapping in BUILT_IN.items():
        here = {j: names[_key(n)] for j, n in mapping.items() if _key(n) in names}
        if _arms(here):
            found[label] = here
    if not found:
        raise BadMocap(
            f"no arm is known in {tracks.source}, which holds {_listed(tracks)}; write "
            "a mapping file with lines such as "
            'right_shoulder = "...", right_elbow = "...", right_hand = "..." and give '
            "it as mapping (--mapping FILE)"
        )
    label = max(found, key=lambda name: len(found[name]))
    return found[label], label


def _arms(joints: Mapping[str, object]) -> list[str]:
    return [s for s in SIDES if all(f"{s}_{j}" in joints for j in ARM)]


def _simple(tracks: Tracks) -> dict[str, str]:
    """Return plain name -> name as the recording spells it; the first one counts."""
    return {_key(name): name for name in reversed(list(tracks.places))}


def _key(name: str) -> str:
    return " ".join(name.rsplit(":", 1)[-1].split()).lower()


def _listed(tracks: Tracks, most: int = 40) -> str:
    names = [name for name in tracks.places if not name.endswith("_end")]
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more
