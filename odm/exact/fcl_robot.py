"""The robot in python-fcl: second opinion of the audit, and a baseline to race.

What to know of python-fcl 0.7: contact answers of convex solids agree with exact
geometry, but distances that involve capsules, cylinders, or a sphere and a hull come
out too large by up to 0.4 mm (never too small); mesh models are hollow. So hulls are
`fcl.Convex` here, and distances are reported, not relied on.
"""

import numpy as np

from odm.obstacles import shapes as solid
from odm.obstacles.robot_surface import solids_of
from roadmap.geometry.solids import hull_facets
from roadmap.kinematics.forward import body_frames
from roadmap.robot.robot import Robot


class FclRobot:
    """The moving solids of a robot, with a broad phase over obstacles."""

    def __init__(self, robot: Robot) -> None:
        import fcl

        self._fcl = fcl
        self.robot = robot
        body = robot.link_body[robot.solid_link].tolist()
        parts = [p for p in zip(solids_of(robot), body, strict=True) if p[1] > 0]
        self._places = [(shape.T_base_shape, b) for shape, b in parts]
        self._objects = [fcl.CollisionObject(geometry_of(one)) for one, _ in parts]
        self._obstacles, self._manager = [], None

    def set_obstacles(self, shapes: list[solid.Shape]) -> None:
        """Replace the obstacles: convex shapes with their poses."""
        fcl = self._fcl
        self._obstacles = [
            fcl.CollisionObject(geometry_of(shape), _transform(shape.T_base_shape))
            for shape in shapes
        ]
        self._manager = fcl.DynamicAABBTreeCollisionManager()
        self._manager.registerObjects(self._obstacles)
        self._manager.setup()

    def collides(self, q: np.ndarray) -> bool:
        """Return whether a solid touches an obstacle at `q`."""
        fcl = self._fcl
        self._place(q)
        for item in self._objects:
            data = fcl.CollisionData()
            self._manager.collide(item, data, fcl.defaultCollisionCallback)
            if data.result.is_collision:
                return True
        return False

    def distance(self, q: np.ndarray) -> float:
        """Return the distance at `q` [m], up to 0.4 mm too large; 0 is contact."""
        fcl = self._fcl
        if self.collides(q):
            return 0.0
        best = np.inf
        for item in self._objects:
            for other in self._obstacles:
                result = fcl.DistanceResult()
                fcl.distance(item, other, fcl.DistanceRequest(), result)
                best = min(best, result.min_distance)
        return best

    def _place(self, q: np.ndarray) -> None:
        poses = body_frames(self.robot, q)
        for item, (T, b) in zip(self._objects, self._places, strict=True):
            item.setTransform(_transform(poses[b] @ T))


def geometry_of(shape: solid.Shape) -> object:
    """Return the fcl geometry of a convex shape, in the shape's frame."""
    import fcl

    if isinstance(shape, solid.Sphere):
        return fcl.Sphere(shape.radius)
    if isinstance(shape, solid.Capsule):
        # fcl takes no capsule of length zero
        if shape.length == 0.0:
            return fcl.Sphere(shape.radius)
        return fcl.Capsule(shape.radius, shape.length)
    if isinstance(shape, solid.Cylinder):
        return fcl.Cylinder(shape.radius, shape.length)
    if isinstance(shape, solid.Box):
        return fcl.Box(*shape.size)
    used, faces = np.unique(hull_facets(shape.vertices), return_inverse=True)
    rows = np.insert(faces.reshape(-1, 3), 0, 3, axis=1)  # facets turned outwards
    return fcl.Convex(shape.vertices[used], len(rows), rows.ravel())


def _transform(T: np.ndarray) -> object:
    import fcl

    return fcl.Transform(T[:3, :3], T[:3, 3])
