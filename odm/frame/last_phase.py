"""The last phase: what the hand may touch when it gives or receives.

The search avoids all points with all layers. The last centimetres are proved by the
close test alone, and there a class of points counts for some layers only:

* give: of `contact` points, the receiving hand, the payload may touch any;
* receive: of `object` points, what is about to be grasped, the finger pads may;
* the rest of the gripper keeps `GRIPPER_KEEPS` from them, the arm its whole clearance.

All other points count as ever: for the arm, the gripper and the payload.
"""

import numpy as np

from odm.checks import CONTACT, OBJECT
from odm.close_test._arm import Arm
from odm.close_test._close import FIRST_SOLID
from odm.close_test.close_test import NO_SOLIDS, CloseTest
from odm.close_test.sorted_clouds import SortedCloud
from odm.frame._path_test import Keepers
from odm.frame.frame import Cover, Frame
from odm.obstacles._solids import Solids
from odm.obstacles.grid import WorkspaceGrid
from odm.obstacles.obstacles import some_of
from roadmap.arrays import writable
from roadmap.errors import BadInput
from roadmap.loading.held_link import PAYLOAD, hanging_on
from roadmap.robot.robot import Robot

GRIPPER_KEEPS = 0.01  # [m]
TOUCHED = {"give": CONTACT, "receive": OBJECT}


class LastPhase:
    """The close test where some links may touch some points."""

    def __init__(self, frame: Frame, grid: WorkspaceGrid | None = None) -> None:
        self.frame = frame
        grid = grid or frame.cell_map.grid
        self._others, self._touched = SortedCloud(grid), SortedCloud(grid)
        # which points, and which shapes, of those looked at may be touched
        self._chosen: np.ndarray | None = None
        self._may_be = np.zeros(0, bool)
        self._gripper_of: tuple[Robot, set[str]] | None = None  # the gripper of a robot
        # of one arm, radii and phase; their arrays are held, so that none is reused
        self._known: tuple[tuple, tuple] | None = None

    def look(
        self,
        phase: str,
        points: np.ndarray,
        classes: np.ndarray | None,
        solids: Solids = NO_SOLIDS,
        kinds: np.ndarray | None = None,
    ) -> None:
        """Take points (n, 3) and solids in the base frame, and the classes of each.

        BadInput for no phase, nothing to give, or no pads to receive with.
        """
        self._may = self.links_that_may(phase)
        if len(points) or self._chosen is None or len(self._chosen):
            chosen = np.zeros(len(points), bool)
            if classes is not None:
                chosen = classes == TOUCHED[phase]
            self._clouds = (
                self._others.of(np.ascontiguousarray(points[~chosen])),
                self._touched.of(np.ascontiguousarray(points[chosen])),
            )
            self._chosen = chosen
        n = solids.count.item()
        kinds = np.zeros(n, np.int8) if kinds is None else kinds
        may = self._may_be = kinds == TOUCHED[phase]
        self._solids = some_of(solids, ~may), some_of(solids, may)

    def hit(
        self,
        cover: Cover,
        q: np.ndarray,
        dq: np.ndarray,
        extra: float = 0.0,
        escape: bool = False,
    ) -> tuple[int, int, float] | None:
        """Test q + t dq; return (sphere, point, metres too near), None where free.

        Instead of a point FIRST_SOLID - k is told for solid k. The spheres of `cover`
        are the arm's, gripper's and payload's; they keep `extra` more [m]. With
        `escape` what is nearer at q already only must not come nearer.
        """
        for k, (test, of) in enumerate(self._tests(cover, extra)):
            if escape:
                test.anchor(q)
            if not test.clear(q, dq, self._clouds[k], escape, self._solids[k]):
                found, point = test.blocked_by
                sphere = found if of is None else int(of[found])
                if point <= FIRST_SOLID:
                    numbers = np.flatnonzero(self._may_be == bool(k))
                    point = FIRST_SOLID - int(numbers[FIRST_SOLID - point])
                elif point >= 0:
                    point = int(np.flatnonzero(self._chosen == bool(k))[point])
                return sphere, point, test.missing
        return None

    def first_hit(
        self, cover: Cover, path: np.ndarray, extra: float, escape: bool
    ) -> int | None:
        """Return the first leg of a path for which `hit` finds something, or None.

        A single corner is a robot at rest.
        """
        tests = enumerate(self._tests(cover, extra))
        blocked = [
            t.first_blocked(path, self._clouds[k], self._solids[k])
            for k, (t, _) in tests
        ]
        begin = min((leg for leg in blocked if leg is not None), default=None)
        if begin is None or not escape:
            return begin  # what keeps its whole distance is an escape, too
        legs = np.diff(path, axis=0) if len(path) > 1 else np.zeros_like(path)
        for k in range(begin, len(legs)):
            if self.hit(cover, path[k], legs[k], extra, escape) is not None:
                return k
        return None

    def _tests(
        self, cover: Cover, extra: float
    ) -> list[tuple[CloseTest, np.ndarray | None]]:
        """Return the tests of what nothing, and what only some, may touch.

        Each with the numbers of its spheres; None: all of the cover's.
        """
        kept, arm, radii, bare = self._protected(cover, self._may)
        tolerance, work = self.frame.cell_map.motion_tolerance, cover.work
        grown = self.frame.grown
        all_radii = grown(cover.radii, cover.bare, extra)
        whole = (cover.arm, all_radii, tolerance, work, cover.bare + extra)
        few = (arm, grown(radii, bare, extra), tolerance, work, bare + extra)
        return [(CloseTest(*whole), None), (CloseTest(*few), kept)]

    def keepers(self, phase: str) -> Keepers:
        """Return the spheres of the frame's cover that may touch nothing in a phase.

        BadInput as `look`.
        """
        return Keepers(
            *self._protected(self.frame.cover(), self.links_that_may(phase))[1:]
        )

    def _protected(
        self, cover: Cover, may: set[str]
    ) -> tuple[np.ndarray, Arm, np.ndarray, np.ndarray]:
        """Return the spheres of links that may not touch: numbers, and `Keepers`."""
        frame, arm = self.frame, cover.arm
        of = (arm, cover.radii, cover.bare, frozenset(may))
        if self._known is not None and _same(self._known[0], of):
            return self._known[1]
        own = self._gripper()
        kept = np.array([n not in may for n in cover.links], bool)
        gripper = np.array([n in own for n in cover.links], bool)
        balls = arm.spheres[:, 3] + GRIPPER_KEEPS
        near = np.array([ball + frame.covering(ball) for ball in balls])
        radii = np.where(gripper, near, cover.radii)[kept]
        bare = np.where(gripper, balls, cover.bare)[kept]
        ends = np.arange(len(arm.tree_i) + 1)
        few = arm._replace(
            spheres=writable(arm.spheres[kept]),  # as those of `arm_of`
            body=writable(arm.body[kept]),
            reach=writable(arm.reach[kept]),
            body_ptr=np.searchsorted(arm.body[kept], ends).astype(np.int64),
        )
        found = np.flatnonzero(kept), few, radii, bare
        copies = (arm, np.copy(cover.radii), np.copy(cover.bare), of[3])
        self._known = copies, found
        return found

    def links_that_may(self, phase: str) -> set[str]:
        """Return the links that may touch something in a phase; BadInput as `look`."""
        frame = self.frame
        if not isinstance(phase, str) or phase not in TOUCHED:
            raise BadInput(
                f"there is no phase {phase!r}; choose 'give' or 'receive', or None"
            )
        if phase == "give":
            if frame.thing is None:
                raise BadInput(
                    "nothing is attached, so nothing can be given; call attach first"
                )
            return {PAYLOAD}
        pads, own = set(frame.finger_pads), self._gripper()
        if not pads or not pads <= own:
            raise BadInput(
                f"the finger pads are {sorted(pads)}, but must be some of the links "
                f"that the tool carries: {', '.join(sorted(own))}; name them in "
                "PlannerSettings(finger_pads=...)"
            )
        return pads

    def _gripper(self) -> set[str]:
        robot = self.frame.robot
        if self._gripper_of is None or self._gripper_of[0] is not robot:
            self._gripper_of = robot, gripper_links(robot)
        return self._gripper_of[1]


def _same(known: tuple, of: tuple) -> bool:
    """Whether arm and phase are those known, and all radii are as they were."""
    return (
        known[0] is of[0]
        and known[3] == of[3]
        and known[1].tobytes() == of[1].tobytes()
        and known[2].tobytes() == of[2].tobytes()
    )


def gripper_links(robot: Robot) -> set[str]:
    """Return the links that the tool's body carries, and those that hang on it."""
    held = hanging_on(robot, int(robot.tip_body))
    pairs = zip(robot.link_names, robot.link_body, strict=True)
    return {name for name, body in pairs if int(body) in held}
