"""Which entries the record of a plan has, and of what kind: `docs/plans.md`."""

import math
from collections.abc import Mapping

from roadmap.errors import BadInput
from roadmap.ranges import is_real, told
from roadmap.transforms import check_pose


def _is_finite(value: object) -> bool:
    return is_real(value) and math.isfinite(value)


_KINDS = {
    "a text": lambda v: isinstance(v, str),
    "a finite number": _is_finite,
    "a finite number or null": lambda v: v is None or _is_finite(v),
    "a list": lambda v: isinstance(v, list),
    "a list of texts": lambda v: (
        isinstance(v, list) and all(isinstance(text, str) for text in v)
    ),
    "joints, each with a finite number": lambda v: (
        isinstance(v, Mapping) and all(map(_is_finite, v.values()))
    ),
}
_TEXT, _NUMBER, _END, _LIST, _TEXTS, _JOINTS = _KINDS
_POSE = "a pose"
_AGENT = {"name": _TEXT, "urdf": _TEXT, "T_world_base": _POSE, "joints": _JOINTS}
_MOTION = {
    **{"name": _TEXT, "who": _TEXT, "joints": _TEXTS},
    **{"times": _LIST, "positions": _LIST},  # `plan_file` looks into them
}
_HOLD = {
    **{"who": _TEXT, "link": _TEXT, "T_link_object": _POSE},
    **{"begin": _NUMBER, "end": _END, "touching": _TEXTS},
}
_FORM = {
    "giver": _AGENT,
    "receiver": _AGENT,
    "scenery": [{"name": _TEXT, "type": _TEXT, "pose": _POSE}],
    "motions": [_MOTION],
    "holds": [_HOLD],
}
# of what only playing it needs
_PLAYED = {
    "scene": {"name": _TEXT},
    "object": {"parts": [{"type": _TEXT, "pose": _POSE}]},
}


def check_form(record: Mapping) -> None:
    """Refuse a record that lacks an entry, or has one of another kind.

    Raises:
        BadInput: Names the entry, and what it should be.
    """
    there = {key: form for key, form in _PLAYED.items() if key in record}
    _check(record, _FORM | there, "the plan")


def _check(value: object, form: dict | list | str, what: str) -> None:
    if isinstance(form, dict):
        if not isinstance(value, Mapping):
            raise BadInput(f"{what} is {told(value)}; give its {', '.join(form)}")
        for key, part in form.items():
            if key not in value:
                raise BadInput(f"{what} lacks {key!r}; make the plan again")
            _check(value[key], part, f"{key} of {what}")
    elif isinstance(form, list):
        _check(value, _LIST, what)
        for k, entry in enumerate(value):
            _check(entry, form[0], f"number {k} of {what}")
    elif form == _POSE:
        check_pose(value, what)
    elif not _KINDS[form](value):
        raise BadInput(f"{what} is {told(value)}; give {form}")
