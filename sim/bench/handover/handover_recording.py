"""`odm bench handover-recording`: recorded hand-overs against what our quality prefers.

The model is fitted to the measured joints of giver and taker; nothing is tuned to the
recording. Every place of the object is judged that both can reach: the taker's quality
there, the best over all rotations of the hand. Then it is told how many of these places
are worse than the real one, and how far our best is from it.

Each keeps the grip's offset from the object that was measured when the taker gripped,
and the object its rotation. Three moments are told apart, since a person who takes
something leans and turns, which the model's trunk does not do by itself:

"body": trunk and gaze as they were when the taker gripped, the taker's arms still as in
    the first frame. The figures asked for are of this one.
"before": everything as in the first frame.
"after": everything as it was when the taker gripped. The arm is there already, so that
    the parts of the way are 1 at the real place: a bound, no prediction.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from handover import Human, QualitySettings
from handover.meet.places import NAMES, PlaceQualities, qualities_at
from sim.bench.handover.recorded_handover import HandoverRecording, read_handover
from sim.tables.header import header
from sim.tables.table import value_row

TOP, NEAR_CM = 90.0, 15.0  # aimed at
SPACING = 0.03  # [m] between the places of the object
ROTATIONS = 576
MOMENTS = ("body", "before", "after")


def run(
    files: list[Path],
    *,
    short: bool = False,
    plot: Path | None = None,
    tell: Callable[[str], None] | None = None,
) -> dict:
    """Judge recorded hand-overs.

    Args:
        files: Folders, each of one hand-over; see
            `sim.bench.handover.recorded_handover`.
        short: Places 8 cm apart and 72 rotations: to see that it runs.
        plot: PNG to draw the first one's places in.
        tell: Called with what is judged.

    Returns:
        Plain data for JSON: "header", "setup", "rows", "tables" and "recordings".
    """
    tell = tell or (lambda text: None)
    spacing, rotations = (0.08, 72) if short else (SPACING, ROTATIONS)
    rows, tables, facts = [], [], []
    for i, folder in enumerate(files):
        recording = read_handover(folder)
        found = {}
        for moment in MOMENTS:
            tell(f"{recording.name}: {moment}")
            found[moment] = judged(recording, moment, spacing, rotations)
        rows += _rows(recording, found["body"])
        tables.append(_table(recording, found))
        facts.append(_facts(recording, found))
        if plot is not None and i == 0:
            from sim.bench.handover.handover_picture import write_handover_picture

            write_handover_picture(recording, found["body"], plot)
    setup = {
        "places": f"{100 * spacing:g} cm apart",
        "rotations of the hand": rotations,
        "settings": "defaults; the share of q_online was chosen after two recordings",
        "body": "trunk as at the grip, taker's arms as in the first frame",
        "before": "all as in the first frame",
        "after": "all as at the grip: the way is 0 at the real place, no prediction",
    }
    result = {"bench": "handover-recording", "header": header(), "setup": setup}
    return result | {"rows": rows, "tables": tables, "recordings": facts}


@dataclass(frozen=True, eq=False)
class Judged:
    """What a recording's places are worth at one moment.

    Attributes:
        giver: The fitted model.
        taker: The fitted model.
        real: (3,) place of the object when the taker gripped [m].
        places: (n, 3) places of the object that both reach [m].
        quality: Of the taker's grip at these; the last row is the real place's.
        offset: (3,) from object to the taker's grip [m].
        reaches: Whether taker and giver reach the real place.
        missing_m: How far the real grip is beyond the taker's straight arm [m], or 0.
    """

    giver: Human
    taker: Human
    real: np.ndarray
    places: np.ndarray
    quality: PlaceQualities
    offset: np.ndarray
    reaches: tuple[bool, bool]
    missing_m: float

    def percentile(self, name: str) -> float:
        """Return how many places are worse than the real one [%]; NaN: out of reach.

        Equals count half.
        """
        values, real = self.quality.best[name][:-1], self.quality.best[name][-1]
        if not len(values) or not np.isfinite(real):
            return np.nan
        worse = (values < real).mean() + 0.5 * (values == real).mean()
        return 100.0 * float(worse)

    def best(self, name: str) -> np.ndarray:
        """Return the best place of the object, (3,) [m]."""
        return self.places[np.nanargmax(self.quality.best[name][:-1])]

    def off_cm(self, name: str) -> float:
        """Return how far the best place is from the real one [cm]."""
        if not len(self.places):
            return np.nan
        return 100.0 * float(np.linalg.norm(self.best(name) - self.real))

    @property
    def middle_off_cm(self) -> float:
        """How far the middle of all places is from the real one [cm]."""
        if not len(self.places):
            return np.nan
        return 100.0 * float(np.linalg.norm(self.places.mean(axis=0) - self.real))

    @property
    def mean_off_cm(self) -> float:
        """How far a place is from the real one on average [cm]."""
        if not len(self.places):
            return np.nan
        return 100.0 * float(np.linalg.norm(self.places - self.real, axis=1).mean())


def judged(
    recording: HandoverRecording, moment: str, spacing: float, rotations: int
) -> Judged:
    """Return what the places of one recording are worth at a moment of `MOMENTS`."""
    frame = 0 if moment == "before" else recording.taken
    side, other = recording.hand("taker"), recording.hand("giver")
    taker, giver = (recording.person(who, frame) for who in ("taker", "giver"))
    if moment == "body":
        rest = recording.person("taker", 0)
        taker = replace(taker, arms=rest.arms)
    real = recording.poses["object"][recording.taken, :3, 3]
    gripping = [recording.person(w, recording.taken) for w in ("taker", "giver")]
    hands = [
        person.T_world_hand(hand)[:3, 3]
        for person, hand in zip(gripping, (side, other), strict=True)
    ]
    offset, giver_offset = (hand - real for hand in hands)
    places = _shared((taker, side, offset), (giver, other, giver_offset), spacing)
    settings, turns = QualitySettings(), {"rotations": rotations}
    theirs = np.vstack([places, real]) + giver_offset
    reached = qualities_at(giver, other, theirs, settings, **turns).reached
    places = places[reached[:-1] > 0]
    ours = np.vstack([places, real]) + offset
    quality = qualities_at(taker, side, ours, settings, **turns)
    own = quality.reached > 0
    keep = np.append(own[:-1], True)
    best = {name: values[keep] for name, values in quality.best.items()}
    quality = PlaceQualities(
        quality.points[keep], best, quality.q[keep], quality.reached[keep]
    )
    shoulder = taker.T_world_shoulder(side)[:3, 3]
    beyond = np.linalg.norm(hands[0] - shoulder) - taker.arm(side).length
    reaches = bool(own[-1]), bool(reached[-1] > 0)
    return Judged(
        giver, taker, real, places[own[:-1]], quality, offset, reaches, max(beyond, 0.0)
    )


def _shared(taker: tuple, giver: tuple, spacing: float) -> np.ndarray:
    """Return the (n, 3) places of the object within both arms' length [m]."""
    centres, radii = [], []
    for person, side, offset in (taker, giver):
        centres.append(person.T_world_shoulder(side)[:3, 3] - offset)
        radii.append(person.arm(side).length)
    low = np.max([c - r for c, r in zip(centres, radii, strict=True)], axis=0)
    high = np.min([c + r for c, r in zip(centres, radii, strict=True)], axis=0)
    sides = [np.arange(a, b + 1e-9, spacing) for a, b in zip(low, high, strict=True)]
    points = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, 3)
    near = np.ones(len(points), bool)
    for centre, radius in zip(centres, radii, strict=True):
        near &= np.linalg.norm(points - centre, axis=1) <= radius
    return points[near]


def _rows(recording: HandoverRecording, found: Judged) -> list[dict]:
    name = recording.name
    note = f"{len(found.places)} places that both reach"
    shown = {"total": "q_total", "online": "q_online"}
    rows = [
        value_row(
            f"{name}: percentile of the real place, {words}",
            found.percentile(quality), "%", note, least=TOP,
        )
        for quality, words in shown.items()
    ]  # fmt: skip
    rows += [
        value_row(
            f"{name}: our best from the real place, {words}",
            found.off_cm(quality), "cm", most=NEAR_CM,
        )
        for quality, words in shown.items()
    ]  # fmt: skip
    rows.append(
        value_row(
            f"{name}: middle of all places from it", found.middle_off_cm, "cm",
            "for comparison: no quality at all",
        )
    )  # fmt: skip
    rows.append(
        value_row(f"{name}: a place from it on average", found.mean_off_cm, "cm")
    )
    return rows


def _table(recording: HandoverRecording, found: dict[str, Judged]) -> dict:
    """Return percentile and distance of each part at each moment."""
    head = ["by", *(f"{m}: %, cm" for m in MOMENTS)]
    rows = [
        [n, *(_pair(found[m].percentile(n), found[m].off_cm(n)) for m in MOMENTS)]
        for n in NAMES
        if n != "combined"
    ]
    shown = [found[m] for m in MOMENTS]
    rows += [
        ["middle of all places", *(_pair(np.nan, f.middle_off_cm) for f in shown)],
        ["real place reached by taker, giver", *map(_reach, shown)],
        ["places that both reach", *(str(len(f.places)) for f in shown)],
    ]
    title = f"{recording.name}: percentile of the real place, and our best from it"
    return {"title": title, "head": head, "rows": rows}


def _pair(percentile: float, off: float) -> str:
    first = "-" if np.isnan(percentile) else f"{percentile:.0f} %"
    return f"{first}, {'-' if np.isnan(off) else f'{off:.0f} cm'}"


def _reach(found: Judged) -> str:
    words = ["yes" if reached else "no" for reached in found.reaches]
    beyond = f" ({100 * found.missing_m:.0f} cm)" if found.missing_m > 0.0 else ""
    return f"{words[0]}{beyond}, {words[1]}"


def _facts(recording: HandoverRecording, found: dict[str, Judged]) -> dict:
    return {
        "name": recording.name,
        "taken_s": round(recording.taken / 120.0, 4),
        "released_s": round(recording.released / 120.0, 4),
        "hands": {w: recording.hand(w) for w in ("giver", "taker")},
        "notes": list(recording.notes),
        "real_m": found["body"].real.round(4).tolist(),
        "moments": {moment: _moment(judged) for moment, judged in found.items()},
    }


def _moment(found: Judged) -> dict:
    names = [n for n in NAMES if n != "combined"]
    rounded = {n: (found.percentile(n), found.off_cm(n)) for n in names}
    return {
        "places": len(found.places),
        "taker_reaches": found.reaches[0],
        "giver_reaches": found.reaches[1],
        "missing_m": round(float(found.missing_m), 4),
        "best_m": found.best("total").round(4).tolist() if len(found.places) else None,
        "middle_off_cm": _plain(found.middle_off_cm),
        "by": {
            n: {"percentile": _plain(a), "off_cm": _plain(b)}
            for n, (a, b) in rounded.items()
        },
    }


def _plain(value: float) -> float | None:
    return None if np.isnan(value) else round(float(value), 2)
