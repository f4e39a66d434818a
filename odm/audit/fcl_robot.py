"""The robot in python-fcl: second opinion of the audit, and a baseline to race.

What to know of python-fcl 0.7: contact answers of convex solids agree with exact
geometry, but distances that involve capsules, cylinders, or a sphere and a hull come
out too large by up to 0.4 mm (never too small); mesh models are hollow. So hulls are
`fcl.Convex` here, and distances are reported, not relied on.
"""

import numpy as np

from odm.obstacles import shapes as solid
from roadmap.geometry.solids import hull_facets
from roadmap.kinematics.forward import body_frames
from roadmap.robot.robot import BOX, CYLINDER, HULL, Robot


class FclRobot:
    """The moving solids of a robot, with a broad phase over obstacles."""

    def __init__(self, robot: Robot) -> None:
        import fcl

        self._fcl = fcl
        self.robot = robot
        body = robot.link_body[robot.solid_link]
        self._used = np.flatnonzero(body > 0)
        self._body = body[self._used]
        self._objects = [
            fcl.CollisionObject(_robot_geometry(robot, i)) for i in self._used
        ]
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
        for k, i in enumerate(self._used):
            T = poses[self._body[k]] @ self.robot.solid_pose[i]
            self._objects[k].setTransform(_transform(T))


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
    return convex_geometry(shape.vertices)


def convex_geometry(points: np.ndarray) -> object:
    """Return `fcl.Convex` around points (n, 3), its facets turned outwards."""
    import fcl

    used, faces = np.unique(hull_facets(points), return_inverse=True)
    rows = np.insert(faces.reshape(-1, 3), 0, 3, axis=1)
    return fcl.Convex(points[used], len(rows), rows.ravel())


def _robot_geometry(robot: Robot, i: int) -> object:
    import fcl

    kind, size = robot.solid_kind[i], robot.solid_size[i]
    if kind == HULL:
        rows = slice(robot.solid_ptr[i], robot.solid_ptr[i + 1])
        return convex_geometry(robot.solid_points[rows])
    if kind == BOX:
        return fcl.Box(*size)
    if kind == CYLINDER:
        return fcl.Cylinder(size[0], size[1])
    return fcl.Sphere(size[0])


def _transform(T: np.ndarray) -> object:
    import fcl

    return fcl.Transform(T[:3, :3], T[:3, 3])
