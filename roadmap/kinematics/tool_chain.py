"""The joints between a robot's base and its tool in a row, and descents along them."""

import math
from functools import lru_cache

import numpy as np

from roadmap.arrays import frozen
from roadmap.errors import BadInput
from roadmap.kinematics._chain import ChainArrays, forward, jacobian
from roadmap.kinematics._inverse import Descent, descend
from roadmap.kinematics.joint_tree import (
    JOINT,
    KIND,
    PARENT,
    PRISMATIC,
    REVOLUTE,
    JointTree,
)
from roadmap.transforms import flat_pose, pose_of_flat, pose_with, rotation_to_z

_LENGTH = 0.3  # [m] counts as much as 1 rad in the dexterity, which is not asked for
_SCALE = 0.1  # [m or rad] that counts as 1 where a descent compares errors
_MOST = 100.0  # one kind of error counts at most so much more than the other


def tool_chain(robot: JointTree) -> tuple[ChainArrays, list[int]]:
    """Return the chain from the base to the tool, and the rows of its joints in `q`.

    Continuous joints have infinite limits, so that a descent goes on past half a turn.
    BadInput where no joint moves the tool.
    """
    bodies, body = [], robot.tip_body
    while body > 0:
        bodies.append(body)
        body = robot.tree_i[body, PARENT]
    fixed, kind, scale, rows = [], [], [], []
    T = np.eye(4)
    for body in bodies[::-1]:
        f = robot.tree_f[body]
        T = T @ pose_of_flat(f[:12])
        if robot.tree_i[body, KIND] not in (REVOLUTE, PRISMATIC):
            continue
        turn = pose_with(rotation_to_z(f[12:15]))
        fixed.append(flat_pose(T @ turn))
        joint = int(robot.tree_i[body, JOINT])
        rows += [] if joint in rows else [joint]
        kind.append((robot.tree_i[body, KIND], joint))
        scale.append(f[15:17])
        T = turn.T
    if not kind:
        raise BadInput(
            f"no joint of {robot.name} moves its tool; give another --tip, or a robot "
            "whose tool is behind a joint that moves"
        )
    fixed.append(flat_pose(T @ robot.T_body_tip))
    rows.sort()
    kind = [(k, rows.index(j)) for k, j in kind]
    limits = np.stack([robot.lower, robot.upper], axis=1)
    limits[robot.continuous] = -np.inf, np.inf
    chain = ChainArrays(
        fixed=frozen(np.array(fixed), float),  # as those of `handover.Chain`
        kind=frozen(np.array(kind), np.int32),
        scale=frozen(np.array(scale), float),
        limits=frozen(limits[rows], float),
        endless=frozen(np.zeros(len(rows)), float),
        length=frozen(np.array([_LENGTH]), float),
    )
    return chain, rows


def descent_of(chain: ChainArrays) -> Descent:
    """Return working memory for descents along a chain."""
    dof = len(chain.limits)
    return Descent(
        frames=np.zeros((len(chain.kind) + 1, 12)),
        jac=np.zeros((6, dof)),
        weighted=np.zeros((dof, 7)),
        gram=np.zeros((6, 6)),
        q=np.zeros(dof),
        dq=np.zeros(dof),
        error=np.zeros(6),
    )


# a frame may solve the inverse kinematics: it takes a third of what the chain does
@lru_cache(maxsize=16)
def _kept_chain(robot: JointTree) -> tuple[ChainArrays, list[int]]:
    return tool_chain(robot)


class ToolDescent:
    """Descents of one robot's tool to poses.

    Args:
        robot: The robot.
        position: Position error to reach [m].
        rotation: Rotation error to reach [rad].
        steps: Most steps of a descent.

    Attributes:
        chain: Its joints between base and tool.
        rows: Their places in `q`; the others do not move the tool and stay.
        scale, goal: What a loop gives `descend`.
        work, trial: Its memory, for one thread.
    """

    def __init__(
        self, robot: JointTree, position: float, rotation: float, steps: int
    ) -> None:
        self.chain, self.rows = _kept_chain(robot)
        self.work = descent_of(self.chain)
        self.trial = np.empty(len(self.rows))
        ratio = min(max(rotation / position, 1.0 / _MOST), _MOST)
        self.scale = _SCALE * np.array([1.0, ratio])
        self._scales, self._rows = np.repeat(self.scale, 3), np.array(self.rows)
        least = min(position / self.scale[0], rotation / self.scale[1])
        self.goal = float(least), float(steps)

    def run(self, target: np.ndarray, q: np.ndarray) -> tuple[float, float]:
        """Move `q` (dof,) in place towards a pose (12,), within limits.

        Returns:
            Position error [m] and rotation error [rad] that are left.
        """
        work, limits = self.work, self.chain.limits
        np.maximum(q[self._rows], limits[:, 0], out=work.q)
        np.minimum(work.q, limits[:, 1], out=work.q)
        descend(self.chain, target, self.scale, self.goal, work, self.trial)
        q[self._rows] = work.q
        x, y, z, u, v, w = (self._scales * work.error).tolist()
        return math.sqrt(x * x + y * y + z * z), math.sqrt(u * u + v * v + w * w)

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """Return the tool's (6, k) Jacobian at q (dof,), of the joints in `rows`.

        Linear [m], then angular; the next call overwrites it.
        """
        work = self.work
        work.q[:] = q[self._rows]
        forward(self.chain, work.q, work.frames)
        jacobian(self.chain, work.frames, work.jac)
        return work.jac
