"""Build a GraspSet: palms above even samples of the surface, fingers closed, held."""

import os
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass

import numpy as np

from handover.grasps.closing import Target, close, target_of
from handover.grasps.grasp_set import GraspSet
from handover.grasps.hand import Hand, load_hand
from handover.grasps.holding import (
    Contacts,
    Skin,
    closure_quality,
    contacts_of,
    quality_bound,
    skin_of,
    wrenches,
)
from handover.grasps.objects import GraspObject
from handover.grasps.surface import even_points
from roadmap.builds.chunks import Progress
from roadmap.errors import BadInput
from roadmap.ranges import CheckedSettings, setting, settings_of
from roadmap.transforms import pose_of_flat


@dataclass(frozen=True)
class GraspSettings(CheckedSettings):
    """How grasps are made.

    Attributes:
        samples: Points on the surface, evenly spread.
        rolls: Turns about the normal tried above each, evenly over a whole turn.
        gap: The palm's first place is this far above the point [m]; room for the arm's
            error of 1 mm, and more.
        back: Where no grasp holds, it goes back by this much and tries again, until
            fingers can no longer reach past the point [m].
        tips: The farthest palm that holds is kept beside the first one, where it is
            farther by at least this [m]: fingertips alone hold what lies on a table.
        friction: Coefficient: 0.5 is about that of rubber pads on painted wood, wet.
        edges: Of the pyramid inside each friction cone.
        tolerance: Fingers stop at most this far from the surface [m].
        pad: How far pads give way: all of the surface that is nearer touches [m].
        least: Smallest quality that counts as held. The hull's own rounding is 1e-9; a
            hold of long things is weak where it resists turning, whatever the hand.
        seed: Same seed, same bytes.
    """

    samples: int = setting(90, 1, 5000)
    rolls: int = setting(8, 1, 72)
    gap: float = setting(0.005, 5e-4, 0.1, "m")
    tips: float = setting(0.04, 0.01, 1.0, "m")
    back: float = setting(0.02, 0.001, 0.2, "m")
    friction: float = setting(0.5, 0.01, 2.0)
    edges: int = setting(5, 3, 32)
    tolerance: float = setting(2e-4, 1e-6, 0.001, "m")
    pad: float = setting(1e-3, 1e-4, 0.005, "m")
    least: float = setting(0.002, 1e-6, 1.0)
    seed: int = setting(1, 0, 2**31)


@dataclass(frozen=True, eq=False)
class _Grasp:
    T: np.ndarray
    values: np.ndarray
    shape: int
    quality: float
    contacts: Contacts


@dataclass(frozen=True, eq=False)
class _Work:
    """What all samples share."""

    thing: GraspObject
    hand: Hand
    target: Target
    skin: Skin
    settings: GraspSettings


def build_grasps(
    thing: GraspObject,
    hand: str | Hand,
    settings: GraspSettings | None = None,
    threads: int = 0,
    progress: Progress | None = None,
) -> GraspSet:
    """Make the grasps of an object by a hand, as [Huaman2014] does, section V-A.4.

    The palm stands above each sample of the surface, its approach along the normal, in
    several turns. The fingers close to first contact. What is in the object, meets
    itself or does not hold it by force closure is refused.

    Args:
        thing: The object.
        hand: The hand, or its name.
        settings: See GraspSettings.
        threads: 0 for one per core; the set does not depend on it.
        progress: Called with (stage, done, total).

    Returns:
        The set, sample after sample; save it with its `save`.

    Raises:
        BadInput: No hand has that name, or no grasp holds the object.
    """
    settings = settings_of(settings, GraspSettings)
    hand = load_hand(hand) if isinstance(hand, str) else hand
    tell = progress or (lambda stage, done, total: None)
    begun = time.perf_counter()
    rng = np.random.default_rng(settings.seed)
    points, normals = even_points(thing, settings.samples, rng)
    skin = skin_of(thing, _spacing(settings), rng)
    work = _Work(thing, hand, target_of(thing), skin, settings)

    def one(k: int) -> tuple[list[_Grasp], Counter]:
        return _above(work, points[k], normals[k])

    found: list[tuple[list[_Grasp], Counter]] = []
    stage = f"closing hands ({hand.spec.name})"  # a plan may need those of several
    with ThreadPoolExecutor(threads or os.cpu_count() or 1) as pool:
        try:
            for grasps in pool.map(one, range(len(points))):
                found.append(grasps)
                tell(stage, len(found), len(points))
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    counts = sum((count for _, count in found), Counter())
    built = {
        "settings": asdict(settings),
        "tried": len(points) * settings.rolls,
        "refused": {name: counts[name] for name in sorted(counts)},
        "seconds": round(time.perf_counter() - begun, 2),
    }
    return _packed(work, [grasps for grasps, _ in found], built)


def _spacing(settings: GraspSettings) -> float:
    """Return how near skin points lie [m]: a pad is never pressed in between unseen.

    A finger of radius 11 mm, the thinnest of our hands, gives way by `pad` over a spot
    of radius sqrt(2 * 11 mm * pad), 4.7 mm: some five points lie in it.
    """
    return 2.0 * np.sqrt(settings.pad * 2e-3)


def _above(
    work: _Work, point: np.ndarray, normal: np.ndarray
) -> tuple[list[_Grasp], Counter]:
    """Return the grasps above a point, two a turn at most, and what was refused."""
    grasps, counts, settings = [], Counter(), work.settings
    for roll in range(work.settings.rolls):
        R = _facing(normal, 2.0 * np.pi * roll / work.settings.rolls)
        gaps = np.arange(settings.gap, 0.8 * work.hand.reach, settings.back)
        grasp, k, why = _first_that_holds(work, point, normal, R, gaps)
        if grasp is None:
            counts[why] += 1
            continue
        grasps.append(grasp)
        end = 0.95 * work.hand.longest  # fingers need not hold beyond their middle
        far = np.arange(settings.gap, end, settings.back)
        far = far[far >= gaps[k] + settings.tips - 1e-9][::-1]
        tip, _, _ = _first_that_holds(work, point, normal, R, far)
        if tip is not None:
            grasps.append(tip)
    return grasps, counts


def _first_that_holds(
    work: _Work, point: np.ndarray, normal: np.ndarray, R: np.ndarray, gaps: np.ndarray
) -> tuple[_Grasp | None, int, str]:
    """Return (grasp or None, index of its gap, why none holds), palm by palm."""
    settings, hand = work.settings, work.hand
    why, T = "the hand is in the object or touches nothing", np.eye(4)
    T[:3, :3] = R
    for k, gap in enumerate(gaps):
        T[:3, 3] = point + gap * normal
        closed = []
        for shape in range(len(hand.preshapes)):
            state = close(hand, work.target, T, shape, settings.tolerance)
            if state is not None:
                why = "the grasp cannot hold it"
                closed.append((state, shape))
        grasp = _best_held(work, closed)
        if grasp is not None:
            return grasp, k, ""
    return None, -1, why


def _best_held(work: _Work, closed: list[tuple[object, int]]) -> _Grasp | None:
    """Return the first closed hand that holds, those with the best bound first."""
    settings, thing, tries = work.settings, work.thing, []
    for state, shape in closed:
        contacts = contacts_of(work.hand, state, work.skin, settings.pad)
        if len(np.unique(contacts.links)) < 2:
            continue
        points = wrenches(
            contacts, thing.center, thing.radius, settings.friction, settings.edges
        )
        tries.append((quality_bound(points), points, contacts, state, shape))
    for bound, points, contacts, state, shape in sorted(tries, key=lambda t: -t[0]):
        quality = closure_quality(points) if bound >= settings.least else 0.0
        if quality >= settings.least:
            T = pose_of_flat(state.palm)
            return _Grasp(T, state.values.copy(), shape, quality, contacts)
    return None


def _facing(normal: np.ndarray, roll: float) -> np.ndarray:
    """Return the rotation whose z goes into the surface, turned about it by `roll`."""
    z = -normal
    side = np.zeros(3)
    side[np.argmin(np.abs(z))] = 1.0
    x = np.cross(side, z)
    x /= np.linalg.norm(x)
    y = np.cross(z, x)
    c, s = np.cos(roll), np.sin(roll)
    return np.column_stack([c * x + s * y, c * y - s * x, z])


def _packed(work: _Work, found: list[list[_Grasp]], built: dict) -> GraspSet:
    grasps = [g for some in found for g in some]
    if not grasps:
        why = [f"{built['tried']} tried"]
        why += [f"{name}: {count}" for name, count in built["refused"].items()]
        raise BadInput(
            f"no grasp of {work.thing.name} by the hand {work.hand.spec.name} holds "
            f"({'; '.join(why)}); take another hand, more "
            "samples or more friction"
        )
    contacts = [g.contacts for g in grasps]
    return GraspSet(
        thing=work.thing,
        hand=work.hand.spec.name,
        joints=work.hand.joints,
        links=work.hand.links,
        T_object_palm=np.array([g.T for g in grasps]),
        values=np.array([g.values for g in grasps]),
        preshape=work.hand.preshapes[[g.shape for g in grasps]],
        quality=np.array([g.quality for g in grasps]),
        sample=np.repeat(np.arange(len(found)), [len(some) for some in found]),
        contact_ptr=np.cumsum([0, *(len(c.points) for c in contacts)]),
        contact_point=np.concatenate([c.points for c in contacts]),
        contact_normal=np.concatenate([c.normals for c in contacts]),
        contact_link=np.concatenate([c.links for c in contacts]),
        built=built,
    )
