"""Which grasps a hand has of an object: stored sets, found again or made."""

from functools import lru_cache
from pathlib import Path

import numpy as np

from handover.grasps._closing import clearance
from handover.grasps.closing import is_outside, target_of
from handover.grasps.grasp_build import build_grasps
from handover.grasps.grasp_set import GraspSet, load_grasps
from handover.grasps.hand import Hand, load_hand, make_hand
from handover.grasps.hands import HandSpec, hand_names, is_known
from handover.grasps.objects import GraspObject
from handover.plans.settings import ProofSettings
from roadmap.builds.chunks import Progress
from roadmap.errors import BadMap

FOLDER = Path("maps/built/grasps")
BACK = (0.0, 0.0, -1.0)  # along the palm's normal, its frame
target_once = lru_cache(maxsize=16)(target_of)
_ALIKE = {"sdh_right": "sdh_left"}  # the same hand on the other arm


def grasps_for(
    thing: GraspObject,
    hand: HandSpec,
    folder: Path | None = None,
    progress: Progress | None = None,
) -> GraspSet:
    """Return the grasps of an object by a hand: the stored set, else a new one, stored.

    Args:
        thing: The object.
        hand: The hand; those that are alike share a set.
        folder: Where sets are, OBJECT-HAND each; `maps/built/grasps` if left. A set of
            a hand of one's own has 12 digits of the hand's fingerprint in its name.
        progress: Called with (stage, done, total) while a set is made, which takes a
            minute.
    """
    name, shape = _ALIKE.get(hand.name, hand.name), make_hand(hand)
    if not is_known(hand) and not _is_like(shape, name):
        name = f"{hand.name}-{shape.fingerprint()[:12]}"
    else:
        shape = load_hand(name)
    path = Path(folder or FOLDER) / f"{thing.name}-{name}"
    found = _stored(path, thing.fingerprint())
    if found is not None:
        return found
    build_grasps(thing, shape, progress=progress).save(path)
    return load_grasps(path)  # its hash is known now


def _is_like(hand: Hand, name: str) -> bool:
    """Return whether a hand is as the known one of that name."""
    known = name in hand_names()
    return known and load_hand(name).fingerprint() == hand.fingerprint()


@lru_cache(maxsize=4096)
def line_clear(
    spec: HandSpec,
    grasps: GraspSet,
    g: int,
    length: float,
    away: tuple[float, float, float] = BACK,
    proof: ProofSettings = ProofSettings(),
) -> bool:
    """Return whether an open hand comes straight to a grasp without cutting the object.

    By conservative advancement on exact distances, on a line of `length` [m] that ends
    in grasp g of the hand `spec`; `away` is the unit vector from there along it, frame
    of the palm.
    """
    hand, target = make_hand(spec), target_once(grasps.thing)
    T, back = grasps.T_object_palm[g].copy(), 0.0
    use, found = np.ones(len(hand.arrays.local), bool), np.full(2, -1)
    step = T[:3, :3] @ np.array(away)
    state = hand.state(T, grasps.preshape[g])
    if not is_outside(hand, state, target, proof.kept):
        return False
    while back < length:
        T[:3, 3] = grasps.T_object_palm[g][:3, 3] + back * step
        state = hand.state(T, grasps.preshape[g])
        gap = clearance(hand.arrays, state, use, target.mesh, proof.longest, found)
        if gap < proof.kept:
            return False
        back += max(gap - proof.kept, proof.shortest)
    return True


def _stored(path: Path, fingerprint: str) -> GraspSet | None:
    manifest = path / "manifest.json"
    if not manifest.is_file():
        return None
    try:
        grasps = _loaded(path, manifest.stat().st_mtime_ns)
    except BadMap:
        return None
    return grasps if grasps.thing.fingerprint() == fingerprint else None


@lru_cache(maxsize=32)
def _loaded(path: Path, changed: int) -> GraspSet:
    return load_grasps(path)
