"""Which key does what: one table for the arm, the session, the screen and the help."""

from dataclasses import dataclass

END, PAUSE, HELP = "q", "p", "?"
HOME, LARGER, SMALLER = "h", "+", "-"


@dataclass(frozen=True)
class Slider:
    """One thing of the arm that a pair of keys moves."""

    name: str  # what it is called on the screen
    # keys that raise and lower its value; the first one is shown
    more: tuple[str, ...]
    less: tuple[str, ...]
    shown: str  # the pair of keys as the screen shows it
    meaning: str  # what the pair does, for the help
    unit: str = "rad"  # "m" or "rad"
    # of the value shown; an abduction to the outside is shown as positive
    sign: float = 1.0


# In the order of `control.ArmState.x`. The person looks along -x of the robot's base,
# so that forward and to the left are negative. Pairs of letters stand one above the
# other on the keyboard.
SLIDERS = (
    Slider("x", ("down",), ("up",), "↑ ↓", "shoulder to the robot, away", "m"),
    Slider("y", ("right",), ("left",), "← →", "shoulder left, right", "m"),
    Slider("z", ("u", "pageup"), ("j", "pagedown"), "u j", "shoulder up, down", "m"),
    Slider("flexion", ("w",), ("s",), "w s", "raise, lower the arm"),
    Slider("abduction", ("d",), ("e",), "e d", "arm out, in", sign=-1.0),
    Slider("rotation", ("r",), ("f",), "r f", "turn the arm in, out"),
    Slider("elbow", ("t",), ("g",), "t g", "bend, stretch the elbow"),
)
OTHERS = (
    ("+ -", "larger, smaller nudge"),
    ("h", "arm back home"),
    ("p", "pause, go on; so does space"),
    ("?", "this help, and back"),
    ("q", "end with the summary"),
)

MOVES = {
    key: (axis, sign)
    for axis, slider in enumerate(SLIDERS)
    for sign, keys in ((1.0, slider.more), (-1.0, slider.less))
    for key in keys
}
ARM_KEYS = frozenset(MOVES) | {HOME, LARGER, SMALLER}
_SAME = {"=": LARGER, "_": SMALLER, " ": PAUSE, "home": HOME}


def plain(key: str) -> str:
    """Return the key's one name: capitals are letters, `=` is an unshifted `+`."""
    return _SAME.get(key, key.lower())
