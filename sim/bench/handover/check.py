"""Check a plan's JSON file without this project: python-fcl, dense in time.

Reads the file that `docs/handover.md` describes, the URDFs it names and their meshes,
and imports nothing of ours: `python sim/bench/handover/check.py plan.json`.

Tested at every moment: both agents against each other, against furniture and against
themselves, and the object against all. Left out: furniture against itself, the agents'
base links against furniture (they stand on it and never move), links of one agent that
are neighbours (no third link with geometry lies between them in the URDF; links welded
by fixed joints count as one), and the object against the links that the file lets touch
it while they hold it. Moments lie so dense that nothing moves farther than `STEP`
between two. python-fcl's distances of round solids are up to 0.4 mm too large; its
contacts are not, so whatever is nearer than 2 mm is asked for contact.
"""

import json
import sys
import xml.etree.ElementTree as ET
from dataclasses import dataclass, field
from pathlib import Path

import fcl
import numpy as np

STEP = 0.004  # [m] farthest that any point moves between two moments
CAP = 0.05  # [m] distances beyond are not looked at
_NEAR = 0.002  # [m] nearer than this, contact is asked for, too
_SAME = 1e-3  # [m] the object may jump by this much where it changes hands
_AT_GOAL = (1e-3, np.radians(0.5))  # [m], [rad]


@dataclass
class Solid:
    """A solid of a link: fcl's geometry, its pose in the link, corners around it."""

    link: str
    geometry: object
    T_link_solid: np.ndarray
    corners: np.ndarray


@dataclass
class Urdf:
    """Links, joints and solids of a URDF."""

    root: str
    order: list  # (joint element data) parents first
    solids: list
    limits: dict
    group: dict  # link -> link that it is welded to
    neighbours: set = field(default_factory=set)


def check_plan(record: dict, step: float = STEP) -> dict:
    """Return what was found in a plan.

    Args:
        record: The plan as in its file.
        step: Farthest that any point moves between two moments [m].

    Returns:
        collisions: (time, one, other) of each that was met, the first of each pair;
        distances: the smallest of each kind, with time and pair; moments; duration_s;
        faults: sentences on limits, jumps and the goal; ok: neither.
    """
    return _Check(record, step).run()


class _Check:
    def __init__(self, record: dict, step: float) -> None:
        self.record, self.step = record, step
        self.urdf, self.items, self.base = {}, {}, {}
        for who in ("giver", "receiver"):
            self.urdf[who] = read_urdf(record[who]["urdf"])
            self.base[who] = np.array(record[who]["T_world_base"])
            self.items[who] = _Items(self.urdf[who].solids)
        self.items["object"] = _Items(
            [_shape(part, f"object {k}") for k, part in enumerate(_parts(record))]
        )
        furniture = [_shape(s, s["name"]) for s in record["scenery"]]
        self.items["scenery"] = _Items(furniture)
        self.items["scenery"].move([s.T_link_solid for s in furniture])
        self.left_out: dict = {}
        self.collisions, self.smallest, self.faults = {}, {}, []

    def run(self) -> dict:
        end = max((m["times"][-1] for m in self.record["motions"]), default=0.0)
        self._limits()
        self._goal(end)
        kinds = [
            ("giver", "receiver"), ("giver", "scenery"), ("receiver", "scenery"),
            ("giver", "giver"), ("receiver", "receiver"), ("object", "scenery"),
            ("object", "giver"), ("object", "receiver"),
        ]  # fmt: skip
        slack, held, moments, before = dict.fromkeys(kinds, 0.0), None, 0, None
        for t in self._moments(end):
            moments += 1
            now = self._place(t)
            moved = {k: 0.0 for k in now} if before is None else _moved(before, now)
            before = now
            touching = self._touching(t)
            for kind in kinds:
                a, b = kind
                slack[kind] -= moved.get(a, 0.0) + moved.get(b, 0.0) * (a != b)
                if a == b:  # both of a pair of its links move
                    slack[kind] -= moved.get(a, 0.0)
                if (
                    slack[kind] > self.smallest.get(kind, (CAP,))[0]
                    and touching == held
                ):
                    continue
                slack[kind] = self._nearest(kind, t, touching)
            held = touching
        names = {kind: "self of " + kind[0] if len(set(kind)) == 1 else " - ".join(kind)
                 for kind in kinds}  # fmt: skip
        return {
            "ok": not self.collisions and not self.faults,
            "collisions": [[t, *pair] for pair, t in self.collisions.items()],
            "distances": {
                names[k]: {"distance_m": v[0], "time_s": v[1], "between": v[2]}
                for k, v in self.smallest.items()
            },
            "faults": self.faults,
            "moments": moments,
            "duration_s": end,
        }

    def joints(self, who: str, t: float) -> dict:
        joints = dict(self.record[who]["joints"])
        for motion in self.record["motions"]:
            if motion["who"] == who and t >= motion["times"][0]:
                rows = np.array(motion["positions"]).T
                for name, row in zip(motion["joints"], rows, strict=True):
                    joints[name] = float(np.interp(t, motion["times"], row))
        return joints

    def _place(self, t: float) -> dict:
        """Put everything where it is at a time; return the corners of what moves."""
        poses = {}
        for who in ("giver", "receiver"):
            poses[who] = forward(self.urdf[who], self.joints(who, t), self.base[who])
            solids = self.items[who].solids
            self.items[who].move([poses[who][s.link] @ s.T_link_solid for s in solids])
        T = self._object(t, poses)
        solids = self.items["object"].solids
        self.items["object"].move([T @ s.T_link_solid for s in solids])
        return {k: self.items[k].corners() for k in ("giver", "receiver", "object")}

    def _object(self, t: float, poses: dict) -> np.ndarray:
        found = []
        for hold in self._holds(t):
            T = np.array(hold["T_link_object"])
            if hold["who"] != "world":
                T = poses[hold["who"]][hold["link"]] @ T
            found.append(T)
        if not found:
            raise ValueError(f"nothing holds the object at {t} s")
        corners = self.items["object"].local()
        places = [corners @ T[:3, :3].T + T[:3, 3] for T in found]
        slip = max(np.linalg.norm(p - places[0], axis=1).max() for p in places)
        if slip > _SAME and not any("slips" in f for f in self.faults):
            self.faults.append(f"the object slips {slip * 1e3:.2f} mm at {t:.3f} s")
        return found[0]

    def _holds(self, t: float) -> list:
        return [
            h for h in self.record["holds"]
            if h["begin"] - 1e-9 <= t and (h["end"] is None or t <= h["end"] + 1e-9)
        ]  # fmt: skip

    def _touching(self, t: float) -> frozenset:
        return frozenset(
            (h["who"], link) for h in self._holds(t) for link in h["touching"]
        )

    def _moments(self, end: float) -> list:
        """Return times between which nothing moves farther than `step`."""
        times = {0.0, end}
        for motion in self.record["motions"]:
            times |= set(motion["times"])
        for hold in self.record["holds"]:
            times |= {hold["begin"], end if hold["end"] is None else hold["end"]}
        times, found = sorted(t for t in times if t <= end), []
        before = None
        for t in times:
            now = self._place(t)
            if before is not None:
                far = max(_moved(before, now).values())
                n = int(np.ceil(1.2 * far / self.step))  # arcs are longer than chords
                found += np.linspace(found[-1], t, max(n, 1) + 1)[1:].tolist()
            else:
                found.append(t)
            before = now
        return found

    def _nearest(self, kind: tuple, t: float, touching: frozenset) -> float:
        """Look for the nearest pair of a kind; return a distance that it keeps."""
        one, other = self.items[kind[0]], self.items[kind[1]]
        gaps = one.gaps(other)  # between boxes around the solids: never too large
        gaps[self._excluded(kind, touching)] = np.inf
        best, pair = CAP, None
        for flat in np.argsort(gaps, axis=None, kind="stable"):
            i, j = np.unravel_index(flat, gaps.shape)
            if gaps[i, j] >= max(best, _NEAR):
                break
            d = _distance(one.objects[i], other.objects[j])
            names = (
                f"{kind[0]}/{one.solids[i].link}",
                f"{kind[1]}/{other.solids[j].link}",
            )
            if d <= 0.0:
                self.collisions.setdefault(names, round(t, 4))
            if d < best:
                best, pair = d, names
        if best < self.smallest.get(kind, (CAP,))[0]:
            self.smallest[kind] = (best, round(t, 4), pair)
        return best

    def _excluded(self, kind: tuple, touching: frozenset) -> np.ndarray:
        """Return (n, m) bool: pairs of a kind that are not tested."""
        if (kind, touching) not in self.left_out:
            one, other = (self.items[k].solids for k in kind)
            out = np.array(
                [
                    self._left_out(kind, a.link, b.link, touching)
                    for a in one
                    for b in other
                ],
                bool,
            ).reshape(len(one), len(other))
            if kind[0] == kind[1]:
                out |= np.tri(len(one), dtype=bool)  # each pair once
            self.left_out[kind, touching] = out
        return self.left_out[kind, touching]

    def _left_out(self, kind: tuple, a: str, b: str, touching: frozenset) -> bool:
        one, other = kind
        if one == other:
            return (a, b) in self.urdf[one].neighbours
        if one == "object":
            return (other, b) in touching
        urdf = self.urdf[one]
        return other == "scenery" and urdf.group[a] == urdf.root

    def _limits(self) -> None:
        for motion in self.record["motions"]:
            urdf = self.urdf[motion["who"]]
            times, rows = np.array(motion["times"]), np.array(motion["positions"])
            for name, row in zip(motion["joints"], rows.T, strict=True):
                low, high, speed = urdf.limits[name]
                if row.min() < low - 1e-3 or row.max() > high + 1e-3:
                    self.faults.append(f"{motion['name']}: {name} leaves its limits")
                fast = np.abs(np.diff(row) / np.diff(times)).max(initial=0.0)
                if fast > 1.001 * speed + 1e-6:
                    self.faults.append(
                        f"{motion['name']}: {name} at {fast:.3f} exceeds {speed:.3f}"
                    )

    def _goal(self, end: float) -> None:
        self._place(0.0)
        at = [self._pose(t) for t in (0.0, end)]
        wanted = [np.array(self.record["object"][k])
                  for k in ("T_world_start", "T_world_goal")]  # fmt: skip
        for name, T, W in zip(("start", "goal"), at, wanted, strict=True):
            off = np.linalg.norm(T[:3, 3] - W[:3, 3])
            cosine = 0.5 * (np.trace(T[:3, :3].T @ W[:3, :3]) - 1.0)
            turned = np.arccos(np.clip(cosine, -1.0, 1.0))
            if off > _AT_GOAL[0] or turned > _AT_GOAL[1]:
                self.faults.append(
                    f"the object is {off * 1e3:.2f} mm and "
                    f"{np.degrees(turned):.2f} deg from its {name}"
                )

    def _pose(self, t: float) -> np.ndarray:
        poses = {
            who: forward(self.urdf[who], self.joints(who, t), self.base[who])
            for who in ("giver", "receiver")
        }
        return self._object(t, poses)


def _distance(one: object, other: object) -> float:
    """Return the distance of two fcl objects [m]; 0 is contact."""
    result = fcl.DistanceResult()
    d = fcl.distance(one, other, fcl.DistanceRequest(), result)
    if d < _NEAR:
        request, met = fcl.CollisionRequest(), fcl.CollisionResult()
        if fcl.collide(one, other, request, met):
            return 0.0
    return max(d, 0.0)


class _Items:
    """Solids as fcl objects, and boxes around them."""

    def __init__(self, solids: list) -> None:
        self.solids = solids
        self.objects = [fcl.CollisionObject(s.geometry) for s in solids]
        self.poses = [np.eye(4)] * len(solids)
        self.around = np.zeros((2, len(solids), 3))

    def move(self, poses: list) -> None:
        self.poses = poses
        for item, T in zip(self.objects, poses, strict=True):
            item.setTransform(fcl.Transform(T[:3, :3], T[:3, 3]))
        corners = self.corners()
        self.around = np.stack([corners.min(axis=1), corners.max(axis=1)])

    def gaps(self, other: "_Items") -> np.ndarray:
        """Return (n, m) distances of the boxes around all solids [m]."""
        (low, high), (far_low, far_high) = self.around, other.around
        apart = np.maximum(far_low[None] - high[:, None], low[:, None] - far_high[None])
        return np.linalg.norm(np.maximum(apart, 0.0), axis=-1)

    def corners(self) -> np.ndarray:
        return np.array(
            [s.corners @ T[:3, :3].T + T[:3, 3]
             for s, T in zip(self.solids, self.poses, strict=True)]
        ).reshape(-1, 8, 3)  # fmt: skip

    def local(self) -> np.ndarray:
        return np.concatenate(
            [s.corners @ s.T_link_solid[:3, :3].T + s.T_link_solid[:3, 3]
             for s in self.solids]
        )  # fmt: skip


def _moved(before: dict, now: dict) -> dict:
    """Bound how far any point moved: displacements are affine, corners go farthest."""
    return {
        k: float(np.linalg.norm(now[k] - before[k], axis=-1).max(initial=0.0))
        for k in now
    }


# --- reading ------------------------------------------------------------------


def read_urdf(path: str) -> Urdf:
    """Read links, joints, solids and neighbours of a URDF."""
    tree = ET.fromstring(Path(path).read_bytes())
    joints, limits = {}, {}
    for node in tree.findall("joint"):
        kind, mimic, limit = node.get("type"), node.find("mimic"), node.find("limit")
        axis = node.find("axis")
        joints[node.find("child").get("link")] = {
            "name": node.get("name"),
            "kind": kind,
            "parent": node.find("parent").get("link"),
            "T": _origin(node),
            "axis": _numbers(axis.get("xyz")) if axis is not None else np.eye(3)[0],
            "mimic": None if mimic is None else (
                mimic.get("joint"), float(mimic.get("multiplier", 1)),
                float(mimic.get("offset", 0)),
            ),
        }  # fmt: skip
        if limit is not None:
            turns = kind == "continuous"
            limits[node.get("name")] = (
                -np.inf if turns else float(limit.get("lower", 0)),
                np.inf if turns else float(limit.get("upper", 0)),
                float(limit.get("velocity", np.inf)),
            )
    links = [node.get("name") for node in tree.findall("link")]
    root = next(name for name in links if name not in joints)
    order, reached = [], [root]
    for parent in reached:
        for child, joint in joints.items():
            if joint["parent"] == parent:
                order.append((child, joint))
                reached.append(child)
    solids = []
    for node in tree.findall("link"):
        shapes = node.findall("collision") or node.findall("visual")
        solids += [_link_solid(node.get("name"), s, Path(path)) for s in shapes]
    group = {root: root}
    for child, joint in order:
        group[child] = group[joint["parent"]] if joint["kind"] == "fixed" else child
    urdf = Urdf(root, order, solids, limits, group)
    urdf.neighbours = _neighbours(urdf)
    return urdf


def _neighbours(urdf: Urdf) -> set:
    """Return pairs of links with geometry with no third between them, both ways."""
    full = {urdf.group[s.link] for s in urdf.solids}
    up = {urdf.root: None}
    for child, joint in urdf.order:
        if urdf.group[child] == child:
            up[child] = urdf.group[joint["parent"]]

    def way(link: str) -> list:
        found = []
        while link is not None:
            found.append(link)
            link = up[link]
        return found

    pairs = set()
    links = {s.link for s in urdf.solids}
    for a in links:
        for b in links:
            wa, wb = way(urdf.group[a]), way(urdf.group[b])
            meet = next(x for x in wa if x in wb)
            between = wa[: wa.index(meet) + 1] + wb[: wb.index(meet)]
            between = [x for x in between if x in full]
            if set(between) <= {urdf.group[a], urdf.group[b]}:
                pairs.add((a, b))
    return pairs


def forward(urdf: Urdf, joints: dict, T_world_base: np.ndarray) -> dict:
    """Return T_world_link of every link."""
    poses = {urdf.root: T_world_base}
    for child, joint in urdf.order:
        T = poses[joint["parent"]] @ joint["T"]
        if joint["kind"] != "fixed":
            name, factor, offset = joint["mimic"] or (joint["name"], 1.0, 0.0)
            value = factor * joints[name] + offset
            T = T @ _motion(joint["kind"], joint["axis"], value)
        poses[child] = T
    return poses


def _motion(kind: str, axis: np.ndarray, value: float) -> np.ndarray:
    T, (x, y, z) = np.eye(4), axis / np.linalg.norm(axis)
    if kind == "prismatic":
        T[:3, 3] = value * np.array([x, y, z])
        return T
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    T[:3, :3] += np.sin(value) * K + (1 - np.cos(value)) * K @ K
    return T


def _numbers(text: str) -> np.ndarray:
    return np.array([float(x) for x in text.split()])


def _origin(node: object) -> np.ndarray:
    T, origin = np.eye(4), node.find("origin")
    if origin is None:
        return T
    for k, angle in enumerate(_numbers(origin.get("rpy", "0 0 0"))):
        T[:3, :3] = _motion("revolute", np.eye(3)[k], angle)[:3, :3] @ T[:3, :3]
    T[:3, 3] = _numbers(origin.get("xyz", "0 0 0"))
    return T


def _link_solid(link: str, node: object, urdf: Path) -> Solid:
    shape, T = node.find("geometry")[0], _origin(node)
    if shape.tag == "box":
        return _made(link, T, "box", _numbers(shape.get("size")))
    if shape.tag == "sphere":
        return _made(link, T, "sphere", float(shape.get("radius")))
    if shape.tag in ("cylinder", "capsule"):
        sizes = float(shape.get("radius")), float(shape.get("length"))
        return _made(link, T, shape.tag, sizes)
    import trimesh

    name = shape.get("filename").split("://")[-1]
    places = [up / name for up in (urdf.parent, *urdf.parents)]
    file = next(place for place in places if place.is_file())
    mesh = trimesh.load(file, force="mesh")
    scale = _numbers(shape.get("scale", "1 1 1"))
    return _made(link, T, "hull", np.asarray(mesh.vertices) * scale)


def _parts(record: dict) -> list:
    return record["object"]["parts"]


def _shape(entry: dict, name: str) -> Solid:
    T, kind = np.array(entry["pose"]), entry["type"]
    if kind == "mesh":
        triangles = np.array(entry["vertices"]), np.array(entry["faces"])
        return _made(name, T, "mesh", triangles)
    if kind == "box":
        return _made(name, T, kind, np.array(entry["size"]))
    if kind == "sphere":
        return _made(name, T, kind, entry["radius"])
    return _made(name, T, kind, (entry["radius"], entry["length"]))


def _made(link: str, T: np.ndarray, kind: str, size: object) -> Solid:
    """Return a solid with the eight corners of a box around it."""
    if kind == "box":
        geometry, high = fcl.Box(*size), 0.5 * np.array(size)
    elif kind == "sphere":
        geometry, high = fcl.Sphere(size), np.full(3, size)
    elif kind == "cylinder":
        geometry = fcl.Cylinder(*size)
        high = np.array([size[0], size[0], 0.5 * size[1]])
    elif kind == "capsule":
        geometry = fcl.Capsule(*size)
        high = np.array([size[0], size[0], 0.5 * size[1] + size[0]])
    else:
        points, faces = size if kind == "mesh" else _hull(size)
        # a mesh that is convex is a solid; another one is its surface
        if kind == "hull" or _is_convex(points, faces):
            points, faces = _hull(points)
            rows = np.insert(faces, 0, 3, axis=1).ravel()
            geometry = fcl.Convex(points, len(faces), rows)
        else:
            geometry = fcl.BVHModel()
            geometry.beginModel(len(points), len(faces))
            geometry.addSubModel(points, faces)
            geometry.endModel()
        return Solid(link, geometry, T, _box(points.min(axis=0), points.max(axis=0)))
    return Solid(link, geometry, T, _box(-high, high))


def _box(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    ends = np.stack([low, high])
    return np.array([[ends[i, 0], ends[j, 1], ends[k, 2]]
                     for i in (0, 1) for j in (0, 1) for k in (0, 1)])  # fmt: skip


def _hull(points: np.ndarray) -> tuple:
    from scipy.spatial import ConvexHull

    hull = ConvexHull(points)
    place = np.full(len(points), -1)
    place[hull.vertices] = np.arange(len(hull.vertices))
    corners, faces = points[hull.vertices], place[hull.simplices]
    a, b, c = (corners[faces[:, k]] for k in range(3))
    inward = np.einsum("ni,ni->n", np.cross(b - a, c - a), hull.equations[:, :3]) < 0
    return corners, np.where(inward[:, None], faces[:, ::-1], faces)


def _is_convex(points: np.ndarray, faces: np.ndarray) -> bool:
    from scipy.spatial import ConvexHull

    a, b, c = (points[faces[:, k]] for k in range(3))
    volume = abs(np.einsum("ni,ni->n", a, np.cross(b, c)).sum()) / 6.0
    return bool(ConvexHull(points).volume - volume <= 1e-9)


def main() -> int:
    """Check the plans that are named and print what was found."""
    wrong = 0
    for name in sys.argv[1:]:
        found = check_plan(json.loads(Path(name).read_text(encoding="utf-8")))
        wrong += not found["ok"]
        print(name, "is free" if found["ok"] else "is NOT free", found["collisions"])
        for kind, row in found["distances"].items():
            print(f"  {kind}: {row['distance_m'] * 1e3:.2f} mm at {row['time_s']} s,",
                  *row["between"])  # fmt: skip
        for fault in found["faults"]:
            print(f"  {fault}")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
