"""What a recording holds before anyone interprets it: named places over time."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from roadmap.arrays import frozen
from roadmap.errors import BadInput

RATES = (10.0, 10_000.0)  # frames per second a recording of a person can have
# [m]; cm before inch: an arm of 0.30 to 0.34 m is a child's, one of 0.76 m nobody's
UNITS = {"m": 1.0, "cm": 0.01, "inch": 0.0254, "mm": 0.001}
FAR = 1e9  # a place beyond this, in any unit, is a fault of the file: not seen


class BadMocap(BadInput):
    """A recording of a person cannot be played; says which value is wrong."""


@dataclass(frozen=True, eq=False)
class Tracks:
    """Places of named bodies or joints, as the file gives them.

    Attributes:
        source: Name of the file, for messages.
        rate_hz: Frames per second.
        places: Name -> (F, 3) place in the file's units and axes; NaN: not seen. A
            name has the namespace of the file, as in "Bob:RSHO".
        metres_per_unit: Where the file says it, else None.
        up: Axis that points up, "y" or "z", where the format fixes it, else None.
        rest: Name -> (3,) place in the skeleton's rest pose, where there is one.
    """

    source: str
    rate_hz: float
    places: dict[str, np.ndarray]
    metres_per_unit: float | None = None
    up: str | None = None
    rest: dict[str, np.ndarray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_rate(self.rate_hz, self.source)
        for name in ("places", "rest"):
            near = {n: _near(p) for n, p in getattr(self, name).items()}
            object.__setattr__(self, name, near)
        if self.n_frames < 2:
            raise BadMocap(
                f"{self.source} holds {self.n_frames} frames; a motion needs 2 or more"
            )

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return max((len(p) for p in self.places.values()), default=0)


def _near(places: np.ndarray) -> np.ndarray:
    """Return (..., 3) places, frozen; what is beyond `FAR` is not seen."""
    near = (np.abs(places) < FAR).all(axis=-1, keepdims=True)
    return frozen(np.where(near, places, np.nan), np.float64)


def check_rate(rate_hz: float, source: str) -> float:
    """Return the rate, or refuse one that no recording of a person has."""
    low, high = RATES
    if not low <= rate_hz <= high:
        raise BadMocap(
            f"{source} gives {rate_hz:g} frames per second; a person's motion needs "
            f"{low:g} to {high:g}: correct the rate in the file"
        )
    return rate_hz


def read_text(path: Path) -> str:
    """Return the text of a recording, or say why there is none."""
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise BadMocap(f"there is no file {path}; give a .csv or .bvh file") from None
    except IsADirectoryError:
        raise BadMocap(f"{path} is a folder; give one of its files") from None
    except OSError as error:
        raise BadMocap(f"{path} cannot be read: {error.strerror}") from None
    if not data.strip():
        raise BadMocap(f"{path.name} is empty; give a .csv or .bvh recording")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")  # older tools write names in it
        if any(c in text for c in "\0\x01\x02\x03\x04\x05\x06\x07\x08"):
            raise BadMocap(
                f"{path.name} is not text, so neither Vicon's .csv nor .bvh"
            ) from None
        return text


def number(text: str, what: str) -> float:
    """Return the number written in `text`; `what` begins a refusal."""
    try:
        return float(text)
    except ValueError:
        remedy = "; write it with a point, not a comma" if "," in text else ""
        if any(word in text.lower() for word in ("nan", "#ind", "inf")):
            remedy = "; write nan for what was not seen"
        raise BadMocap(
            f"{what} is {text.strip()[:40]!r}, which is no number{remedy}"
        ) from None
