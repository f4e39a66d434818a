"""The force-torque sensor at the robot's wrist, simulated.

Both feel the object's weight, which turns with the hand; the person's pull, away from
the robot's hand; the bump of the first touch; and noise.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from handover.meet.held_object import HeldObject

GRAVITY = 9.81  # [m/s2]
BUMP_S = 0.04  # [s] a bump is half a sine


class PlainWrist:
    """The forces added up: what is needed without a simulator."""

    def __init__(self, obj: HeldObject) -> None:
        self._arm = np.array(obj.T_tool_object[:3, 3])

    def wrench(
        self, T_base_tool: np.ndarray, mass: float, force: np.ndarray
    ) -> np.ndarray:
        """Return (6,) force and torque, tool frame, of what hangs in the hand.

        `mass` is its own [kg]; `force` (3,) acts on its middle, base frame [N].
        """
        down = np.array([0.0, 0.0, -GRAVITY * mass])
        total = T_base_tool[:3, :3].T @ (down + force)
        return np.concatenate([total, np.cross(self._arm, total)])

    def close(self) -> None:
        """Nothing is open."""


class SimulatedWrist:
    """Reaction forces of a fixed joint in pybullet, of the object that hangs on it.

    The hand is moved where the robot has it, the object hangs on a fixed joint whose
    reaction pybullet reports, and the person's pull acts on the object. Between two
    frames the simulation does several steps, so that its solver settles.

    Raises:
        SimulatorMissing: pybullet is not installed.
    """

    STEPS = 4  # of the simulation for each frame
    LIGHT = 1e-3  # [kg] of an empty hand

    def __init__(self, obj: HeldObject) -> None:
        from sim.draw.world import connected

        self._p = p = connected()
        p.setGravity(0, 0, -GRAVITY)
        self._arm = np.array(obj.T_tool_object[:3, 3])
        ball = p.createCollisionShape(p.GEOM_SPHERE, radius=0.01)
        self._body = p.createMultiBody(
            baseMass=0.0,
            baseCollisionShapeIndex=-1,
            linkMasses=[obj.mass_kg],
            linkCollisionShapeIndices=[ball],
            linkVisualShapeIndices=[-1],
            linkPositions=[self._arm.tolist()],
            linkOrientations=[[0, 0, 0, 1]],
            linkInertialFramePositions=[[0, 0, 0]],
            linkInertialFrameOrientations=[[0, 0, 0, 1]],
            linkParentIndices=[0],
            linkJointTypes=[p.JOINT_FIXED],
            linkJointAxis=[[0, 0, 1]],
            useMaximalCoordinates=False,
        )
        p.enableJointForceTorqueSensor(self._body, 0, 1)
        self._mass = obj.mass_kg

    def wrench(
        self, T_base_tool: np.ndarray, mass: float, force: np.ndarray
    ) -> np.ndarray:
        """Return (6,) force and torque, tool frame; see `PlainWrist`."""
        p, body = self._p, self._body
        if mass != self._mass:
            self._mass = mass
            p.changeDynamics(body, 0, mass=max(mass, self.LIGHT))
        place = T_base_tool[:3, 3].tolist()
        turn = Rotation.from_matrix(T_base_tool[:3, :3]).as_quat().tolist()
        p.resetBasePositionAndOrientation(body, place, turn)
        middle = (T_base_tool[:3, 3] + T_base_tool[:3, :3] @ self._arm).tolist()
        for _ in range(self.STEPS):
            p.applyExternalForce(body, 0, force.tolist(), middle, p.WORLD_FRAME)
            p.stepSimulation()
        reaction = p.getJointState(body, 0)[2]
        return -np.array(reaction)  # what the object does to the hand

    def close(self) -> None:
        """End the simulation."""
        self._p.disconnect()


Wrist = PlainWrist | SimulatedWrist


def person_force(
    T_base_tool: np.ndarray, pull: float, since_touch: float, bump: float
) -> np.ndarray:
    """Return (3,) force of a person on the object, base frame [N].

    The pull [N] is along the tool's z, out of it; the bump of the touch `since_touch`
    ago [s] goes the other way and aside.
    """
    force = pull * T_base_tool[:3, 2]
    if 0.0 <= since_touch < BUMP_S:
        size = bump * np.sin(np.pi * since_touch / BUMP_S)
        force = force + size * (0.8 * T_base_tool[:3, 0] - 0.6 * T_base_tool[:3, 2])
    return force
