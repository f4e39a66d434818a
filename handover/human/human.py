"""A person: trunk, head with gaze, two arms of seven hinges, legs by posture.

Frames: world has z up and the floor at 0; the pelvis, chest and shoulder frames have x
to the front, y to the left, z up the trunk; the hand's is described in
`handover/human/human_arm.py`. A `Human` is frozen and cheap (no tables): another
height, place or arm posture is another `Human`, and reachability maps, which are in
units of arm length, stay valid.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np

from handover.human import anthropometry as body
from handover.human._human_arm import body_places
from handover.human.body import (
    ARM_LABELS,
    COLUMN,
    JOINTS,
    LEG_LABELS,
    BodySizes,
    Part,
    UpperBody,
    leg_capsules,
)
from handover.human.human_arm import (
    SIDES,
    STEP,
    Arm,
    ArmSolutions,
    check_joints,
    check_side,
)
from handover.human.postures import Posture, floor_pose, leg_places, posture_named
from handover.human.skeleton import Skeleton
from odm.obstacles.obstacles import Obstacles
from odm.obstacles.surfaces import sample_capsules
from roadmap.arrays import as_floats, brief, frozen
from roadmap.errors import BadInput
from roadmap.geometry.gaps import moved_rods
from roadmap.ranges import check_kind, is_between
from roadmap.transforms import check_pose, inverse_pose, rotation_rpy

_ROUNDING = 1e-15  # by which the length of a direction is off 1


@dataclass(frozen=True, eq=False)
class Human:
    """One person at one moment.

    Attributes:
        height: Body height [m], 1.2 to 2.2.
        posture: A name out of `handover.human.postures.POSTURES`: legs, bend of the
            trunk, and what the arms do unless `arms` says. It does not turn the pelvis
            when `T_world_pelvis` is given.
        T_world_pelvis: (4, 4) pose of the pelvis [m]; None: resting on the floor at the
            origin, facing x.
        arms: Side -> (7,) joints [rad]; a side left out is as in the posture. Measured
            joints may lie outside their ranges.
        gaze: (3,) direction the person looks in, world frame; None: not known.
        skeleton: Lengths between the joints; None: fractions of the height.
        mass: Of the body [kg]; None: that of a body mass index of 24.
        thickness: "conservative" (thick man, clothed; for keeping away) or "mean".
        bend: (3,) roll, pitch, yaw of the chest against the pelvis [rad]; None: as in
            the posture.
        T_world_chest: (4, 4) pose of the chest, its origin in the joint that bends it
            against the pelvis; computed.
        places: (11, 3) of `handover.human.body.JOINTS`, world frame [m]; computed. A
            tip is one hand radius short of the finger tips, so that the capsule ends
            there.
    """

    height: float = 1.75
    posture: str = "standing"
    T_world_pelvis: np.ndarray | None = None
    arms: Mapping[str, np.ndarray] = field(default_factory=dict)
    gaze: np.ndarray | None = None
    skeleton: Skeleton | None = None
    mass: float | None = None
    thickness: str = "conservative"
    bend: np.ndarray | None = None
    T_world_chest: np.ndarray = field(init=False)

    __repr__ = brief

    def __post_init__(self) -> None:
        body.check_height(self.height, "nothing is known of the shape of such a person")
        posture = posture_named(self.posture)
        body.check_thickness(self.thickness)
        put = object.__setattr__
        check_kind("arms", self.arms, Mapping, "give side -> (7,) joints")
        if self.skeleton is None:
            put(self, "skeleton", Skeleton.of_height(self.height))
        check_kind("skeleton", self.skeleton, Skeleton, "give a Skeleton, or None")
        if self.mass is None:
            put(self, "mass", body.BODY_MASS_INDEX * self.height**2)
        if not is_between(self.mass, 1e-9, 500):
            raise BadInput(f"a body mass of {self.mass} kg is none; give kilograms")
        put(self, "gaze", _direction(self.gaze))
        bend = [0.0, np.radians(posture.chest), 0.0] if self.bend is None else self.bend
        put(self, "bend", _checked_bend(bend))
        put(self, "arms", _joints(self.arms, posture))
        T = self.T_world_pelvis
        if T is None:
            T = floor_pose(self.skeleton, posture, self.sizes)
        put(self, "T_world_pelvis", frozen(check_pose(T, "T_world_pelvis"), np.float64))
        put(self, "T_world_chest", frozen(self._chest(), np.float64))

    @cached_property
    def places(self) -> np.ndarray:
        """(11, 3) places of the joints [m]; most people of a frame are asked none."""
        return frozen(self._places_with(self.arms), np.float64)

    @property
    def sizes(self) -> BodySizes:
        """Thickness of the parts."""
        return _upper_body(self.height, self.thickness).sizes

    @property
    def p_world_eyes(self) -> np.ndarray:
        """(3,) place between the eyes [m]."""
        offset = [body.EYES_FORWARD, 0.0, body.NECK_TO_EYES]
        R = self.T_world_chest[:3, :3]
        return self.places[COLUMN["neck"]] + self.height * R @ offset

    @property
    def labels(self) -> np.ndarray:
        """(k,) `handover.human.body.Part` of each of `capsules()`, int64."""
        upper = _upper_body(self.height, self.thickness).labels
        return np.concatenate([upper, LEG_LABELS])

    def arm(self, side: str) -> Arm:
        """Return the arm "left" or "right", without its place."""
        lengths = self.skeleton.arms[SIDES.index(check_side(side))]
        return _arm(side, tuple(lengths.tolist()))

    def T_world_shoulder(self, side: str) -> np.ndarray:
        """Return the (4, 4) pose of a shoulder frame; it follows pelvis and trunk."""
        T = self.T_world_chest.copy()
        T[:3, 3] += T[:3, :3] @ self.skeleton.shoulders[SIDES.index(check_side(side))]
        return T

    def T_world_hand(self, side: str) -> np.ndarray:
        """Return the (4, 4) pose of a hand as it is now."""
        return self.T_world_shoulder(side) @ self.arm(side).fk(self.arms[side])

    def arm_ik(
        self, side: str, T_world_hand: np.ndarray, step: float = STEP
    ) -> ArmSolutions:
        """Return all joints, inside their ranges, that put a hand at a pose.

        Args:
            side: "left" or "right".
            T_world_hand: (4, 4) pose of the hand [m].
            step: Largest swivel between neighbouring representatives [rad].

        Raises:
            BadInput: An unknown side, a pose that is not rigid, a bad step.
        """
        T_world_hand = check_pose(T_world_hand, "T_world_hand")
        T_shoulder_world = inverse_pose(self.T_world_shoulder(side))
        return self.arm(side).ik(T_shoulder_world @ T_world_hand, step)

    def reach_pose(self, side: str, T_world_hand: np.ndarray) -> np.ndarray:
        """Return a hand pose as reachability maps of a person's arm hold it, (4, 4).

        In the shoulder frame, so that it follows bending, crouching and turning; a left
        arm's is mirrored, since one map serves both; in units of the arm's length.
        """
        arm = self.arm(side)
        T_world_hand = check_pose(T_world_hand, "T_world_hand")
        T = arm.mirrored(inverse_pose(self.T_world_shoulder(side)) @ T_world_hand)
        T[:3, 3] /= arm.length
        return T

    def moved(self, T_world_pelvis: np.ndarray) -> "Human":
        """Return the person with the pelvis elsewhere, all joints alike."""
        return replace(self, T_world_pelvis=T_world_pelvis)

    def placed(self, x: float, y: float, yaw: float) -> "Human":
        """Return the person resting on the floor at x, y [m], facing `yaw` [rad]."""
        place = tuple(as_floats("x, y and yaw", [x, y, yaw]).tolist())
        if not np.isfinite(place).all():
            raise BadInput(f"nobody stands at {place}; give finite x, y [m], yaw [rad]")
        posture = posture_named(self.posture)
        return self.moved(floor_pose(self.skeleton, posture, self.sizes, place))

    def resized(self, height: float) -> "Human":
        """Return a person of another height [m] in the same place and posture.

        All lengths are scaled, measured ones too; the pelvis rises as it would on the
        floor.
        """
        body.check_height(height, "nothing is known of the shape of such a person")
        factor = height / self.height
        T = self.T_world_pelvis.copy()
        T[2, 3] += self._floor_height(factor) - self._floor_height(1.0)
        skeleton, mass = self.skeleton.scaled(factor), self.mass * factor**2
        return replace(
            self, height=height, T_world_pelvis=T, skeleton=skeleton, mass=mass
        )

    def with_arm(self, side: str, q: np.ndarray) -> "Human":
        """Return the person with other joints (7,) of one arm [rad]."""
        return replace(self, arms={**self.arms, check_side(side): q})

    def looking(self, gaze: np.ndarray | None) -> "Human":
        """Return the person looking in a world direction (3,), or None: not known."""
        return replace(self, gaze=gaze)

    def looking_at(self, p_world: np.ndarray) -> "Human":
        """Return the person looking at a place (3,) [m]."""
        p_world = as_floats("p_world", p_world)
        if p_world.shape != (3,):
            raise BadInput(f"p_world has shape {p_world.shape}; give a place (3,) [m]")
        return self.looking(p_world - self.p_world_eyes)

    def capsules(self) -> np.ndarray:
        """Return the whole body as closed capsules (k, 7) a, b, radius, world [m].

        Hands, forearms, upper arms, torso, shoulders and head as `UpperBody` makes
        them of the joints, then thigh, shank and foot of both legs; see `labels`.
        """
        return self.capsules_of(self.thickness)

    def capsules_of(self, thickness: str) -> np.ndarray:
        """Return `capsules` of another thickness."""
        body_of = _upper_body(self.height, thickness)
        legs = _legs(self.skeleton, posture_named(self.posture), body_of.sizes)
        return body_of.with_legs(self.places, legs, self.T_world_pelvis)

    def arm_capsules(self, side: str, joints: np.ndarray) -> np.ndarray:
        """Return hand, forearm and upper arm of one arm, bent otherwise.

        Args:
            side: "left" or "right".
            joints: (n, 7) joints of that arm, once for each answer [rad].

        Returns:
            (n, 3, 7) capsules a, b, radius, world [m].
        """
        body_of = _upper_body(self.height, self.thickness)
        rows, arms = np.isin(body_of.labels, ARM_LABELS[check_side(side)]), self.arms
        joints = map(check_joints, np.atleast_1d(as_floats("joints", joints)))
        places = (self._places_with({**arms, side: q}) for q in joints)
        return np.array([body_of.capsules(at)[rows] for at in places]).reshape(-1, 3, 7)

    def surface_points(
        self, spacing: float = 0.03, T_world_base: np.ndarray | None = None
    ) -> np.ndarray:
        """Return points on the whole body, the planner's input.

        Args:
            spacing: Bound on the covering radius [m]; at most the map's rho.
            T_world_base: (4, 4) pose of the robot's base, whose frame the planner
                uses; None: it is the world's.

        Returns:
            (n, 3) [m]; each capsule is closed, its caps are covered.
        """
        return sample_capsules(_seen_from(T_world_base, self.capsules()), spacing)

    def obstacles(self, T_world_base: np.ndarray | None = None) -> Obstacles:
        """Return the whole body as shapes, labelled: the planner's input.

        Args:
            T_world_base: As in `surface_points`.
        """
        rods = _seen_from(T_world_base, self.capsules())
        names = [Part(label).words for label in self.labels]
        return Obstacles(capsules=rods, labels={"capsules": names})

    def _floor_height(self, factor: float) -> float:
        skeleton, posture = self.skeleton.scaled(factor), posture_named(self.posture)
        return floor_pose(skeleton, posture, self.sizes)[2, 3]

    def _chest(self) -> np.ndarray:
        T = self.T_world_pelvis.copy()
        T[:3, 3] += self.skeleton.trunk * T[:3, 2]
        T[:3, :3] = T[:3, :3] @ rotation_rpy(*self.bend)
        return T

    def _places_with(self, joints: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return (11, 3) places of the joints for arms bent otherwise [m]."""
        places = np.empty((len(JOINTS), 3))
        poses = np.array(self.T_world_pelvis), np.array(self.T_world_chest)
        arms = [np.array(joints[side]) for side in SIDES]
        given = _lengths(self.skeleton, self.sizes.hand)
        body_places(given, *poses, *arms, places)
        return places


# what depends on a few numbers only, kept for the next frame of the same person
@lru_cache(maxsize=64)
def _upper_body(height: float, thickness: str) -> UpperBody:
    return UpperBody(JOINTS, BodySizes.sized(height, thickness))


@lru_cache(maxsize=64)
def _lengths(skeleton: Skeleton, palm: float) -> np.ndarray:
    """Return (23,) lengths as `body_places` takes them [m]."""
    beyond = np.maximum(skeleton.hands - palm, 0.0) / skeleton.arms[:, 2]
    chest = (skeleton.neck, skeleton.skull, skeleton.shoulders.ravel())
    return np.concatenate([skeleton.hip, *chest, skeleton.arms.ravel(), beyond])


@lru_cache(maxsize=64)
def _legs(skeleton: Skeleton, posture: Posture, sizes: BodySizes) -> np.ndarray:
    """Return (6, 7) capsules of both legs in the pelvis frame [m]."""
    return frozen(leg_capsules(leg_places(skeleton, posture), sizes), np.float64)


@lru_cache(maxsize=64)
def _arm(side: str, lengths: tuple[float, ...]) -> Arm:
    return Arm(side, np.array(lengths))


def _joints(
    arms: Mapping[str, np.ndarray], posture: Posture
) -> Mapping[str, np.ndarray]:
    """Return the joints of both arms, those not given as in the posture."""
    for side in arms:
        check_side(side)
    rest = np.radians(posture.arm)
    return {s: frozen(check_joints(arms.get(s, rest)), np.float64) for s in SIDES}


def _checked_bend(bend: np.ndarray) -> np.ndarray:
    bend = as_floats("a bend of the trunk", bend)
    if bend.shape != (3,) or not (np.abs(bend) <= np.pi / 2).all():
        raise BadInput(
            f"a bend of the trunk of {bend.tolist()} is none; give roll, pitch, yaw of "
            "the chest against the pelvis, each within pi / 2 rad"
        )
    return frozen(bend, np.float64)


def _direction(gaze: np.ndarray | None) -> np.ndarray | None:
    if gaze is None:
        return None
    gaze = as_floats("gaze", gaze)
    length = np.linalg.norm(gaze)
    if gaze.shape != (3,) or not 1e-9 < length < np.inf:
        raise BadInput(
            f"a gaze of {gaze.tolist()} is no direction; give (3,) numbers, not "
            "all zero, or None where it is not known"
        )
    if abs(length - 1.0) > _ROUNDING:  # else it would not stay the same to the bit
        gaze = gaze / length
    return frozen(gaze, np.float64)


def _seen_from(T_world_base: np.ndarray | None, capsules: np.ndarray) -> np.ndarray:
    if T_world_base is None:
        return capsules
    T = inverse_pose(check_pose(T_world_base, "T_world_base"))
    return moved_rods(capsules, T)
