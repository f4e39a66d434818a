"""What a URDF file says, checked: links, joints and shapes as plain data."""

import codecs
import difflib
import io
import math
import os
import re
from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from roadmap.errors import BadRobot
from roadmap.ranges import is_number

MOVABLE = ("revolute", "continuous", "prismatic")
# A stop farther away than this is none: exporters write 1e16 for "endless" [rad].
NO_STOP = 1000.0
# Revolute joints of real arms stop within three turns; degrees do so within 720 [rad].
MOST_TURNED, MOST_DEGREES = 6.0 * math.pi, 720.0
# How many numbers stand where in a link or a joint; (): that is told elsewhere.
_NUMBERS: dict[str, dict[str, tuple[int, ...]]] = {
    "origin": {"xyz": (3,), "rpy": (3,)},
    "axis": {"xyz": (3,)},
    "limit": {"lower": (1,), "upper": (1,), "velocity": (1,), "effort": (1,)},
    "mimic": {"multiplier": (1,), "offset": (1,)},
    "box": {"size": ()},
    "cylinder": {"radius": (1,), "length": (1,)},
    "sphere": {"radius": (1,)},
    "mesh": {"scale": (1, 3)},
}
_SHAPES = {  # what each has to say
    "box": ("size",),
    "cylinder": ("radius", "length"),
    "sphere": ("radius",),
    "mesh": ("filename",),
}
# What may stand in them but the numbers and what a shape has to say; `rpy` of an axis
# is in files, and no reader takes it.
_MORE = {"axis": ("rpy",), "mimic": ("joint",)}
_PARTS = {  # what stands in what, and is read or known to be of no use here
    "robot": ("link", "joint"),
    "link": ("collision", "visual", "inertial"),
    "joint": (
        "parent", "child", "origin", "axis", "limit", "mimic", "dynamics",
        "safety_controller", "calibration",
    ),
    "collision": ("origin", "geometry"),
    "visual": ("origin", "geometry", "material"),
}  # fmt: skip
_ALIKE = 0.8  # of difflib: how near a name with a slip is to the one that was meant
_ONCE = {  # what is read once, so that a second one would be dropped
    "joint": ("parent", "child", "origin", "axis", "limit", "mimic"),
    "collision": ("origin", "geometry"),
    "visual": ("origin", "geometry"),
}


@dataclass(frozen=True, eq=False)
class Shape:
    """One <geometry>: kind box, cylinder, sphere or mesh, at `T_link_shape`.

    `size` is the full size, (radius, length) or (radius,) [m]; the scale of a mesh,
    and `scaled` says whether the file gives one.
    """

    kind: str
    size: tuple[float, ...]
    filename: str
    T_link_shape: np.ndarray
    scaled: bool = True


@dataclass(frozen=True, eq=False)
class Link:
    """A URDF link with its collision and visual shapes."""

    name: str
    collisions: tuple[Shape, ...]
    visuals: tuple[Shape, ...]


@dataclass(frozen=True, eq=False)
class Joint:
    """A URDF joint; limits are None where the file has none [rad or m].

    A continuous joint has none: one that is given a range is a revolute joint here.
    """

    name: str
    kind: str
    parent: str
    child: str
    T_parent_joint: np.ndarray
    axis: np.ndarray
    lower: float | None
    upper: float | None
    velocity: float | None
    mimic: tuple[str, float, float] | None


@dataclass(frozen=True, eq=False)
class Description:
    """A checked URDF: one tree of links under `root`.

    `remarks` say by joint what a user should know of how its limits were read.
    """

    name: str
    root: str
    links: dict[str, Link]
    joints: dict[str, Joint]
    remarks: dict[str, str] = field(default_factory=dict)

    def children(self, link: str) -> list[Joint]:
        """Return the joints that hang from `link`, in the order of the file."""
        return [j for j in self.joints.values() if j.parent == link]

    def below(self, link: str) -> list[Joint]:
        """Return the joints of all links beyond `link`, parents first."""
        joints = self.children(link)
        for joint in joints:
            joints += self.children(joint.child)
        return joints

    def parent_joint(self, link: str) -> Joint | None:
        """Return the joint that carries `link`, None for the root."""
        return next((j for j in self.joints.values() if j.child == link), None)

    def path(self, link: str) -> list[Joint]:
        """Return the joints from the root to `link`."""
        joints: list[Joint] = []
        joint = self.parent_joint(link)
        while joint is not None:
            joints.append(joint)
            joint = self.parent_joint(joint.parent)
        return joints[::-1]

    def adjacent(self) -> set[frozenset[str]]:
        """Return pairs of links joined by a joint, or by links without geometry."""
        pairs = set()
        for link in self.links.values():
            joint = self.parent_joint(link.name)
            while joint is not None:
                pairs.add(frozenset((joint.parent, link.name)))
                parent = self.links[joint.parent]
                if parent.collisions or parent.visuals:
                    break
                joint = self.parent_joint(parent.name)
        return pairs


def read_description(
    path: str | os.PathLike, endless: Collection[str] = ()
) -> Description:
    """Read a URDF file strictly; nothing is guessed or skipped silently.

    Args:
        path: The file.
        endless: Continuous joints that are known to turn without end, so that limits
            in the file stand for something else.

    Raises:
        BadRobot: The file is missing, is not well-formed XML or is not a robot.
    """
    path = Path(path)
    if not path.is_file():
        raise BadRobot(
            f"there is no URDF file at {str(path)!r}; give the path of a .urdf file"
        )
    data = well_formed(path)
    # parser and its dependencies take most of a second to import
    from yourdfpy import URDF

    try:
        model = URDF.load(
            io.BytesIO(data), build_scene_graph=False, load_meshes=False
        ).robot
    except Exception as error:
        raise BadRobot(
            f"{path.name} is not a usable URDF: {type(error).__name__}: {error}; "
            "check it with check_urdf, and expand xacro files first"
        ) from error
    return _bounded(_checked(model, path.name), path.name, endless)


def read_xml(path: Path):
    """Return the root of an XML file, whatever its text is stored in.

    Raises:
        BadRobot: It is not well-formed.
    """
    from lxml import etree

    data = path.read_bytes()
    try:
        data.decode("utf-8")
    except UnicodeDecodeError:
        # an old file with Latin-1 comments: names and numbers are ASCII anyway
        if not data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
            data = data.decode("latin-1").encode("ascii", "replace")
    # files beside pybullet declare this; whatever it is, they are plain XML
    data = re.sub(rb'^(\s*<\?xml version=["\'])0\.\d(?=["\'])', rb"\g<1>1.0", data)
    parser = etree.XMLParser(recover=True, resolve_entities=False)
    try:
        root = etree.fromstring(data, parser) if data.strip() else None
    except etree.XMLSyntaxError:  # nothing can be recovered
        root = None
    bad = [e for e in parser.error_log if "NS_ERR" not in e.type_name]
    if root is None or bad:
        where = f"line {bad[0].line}: {bad[0].message}" if bad else "it is empty"
        raise BadRobot(f"{path.name} is not well-formed XML ({where}); repair the file")
    for part in root.iter("{*}*"):
        # <robot xmlns="http://drake.mit.edu"> is a robot; ROS knows no name spaces
        space, _, name = part.tag.rpartition("}")
        if space and part.prefix is None and not _is_xacro(part.tag):
            part.tag = name
    etree.cleanup_namespaces(root)
    return root


def well_formed(path: Path) -> bytes:
    """Return the XML of a URDF file in UTF-8, whatever it is stored in.

    Raises:
        BadRobot: It is not well-formed, or not a robot.
    """
    from lxml import etree

    root = read_xml(path)
    if path.suffix == ".xacro":
        raise BadRobot(
            f"{path.name} is a xacro file; expand it first: xacro {path.name} > "
            f"{path.name.partition('.')[0]}.urdf"
        )
    left = next((e.tag for e in root.iter(etree.Element) if _is_xacro(e.tag)), None)
    if left is not None:
        raise BadRobot(
            f"{path.name} still has the element <xacro:{re.split('[:}]', left)[-1]}>, "
            f"which a URDF does not know; run xacro first: xacro {path.name} > "
            f"{path.stem}_expanded.urdf"
        )
    if root.tag != "robot":
        raise BadRobot(
            f"{path.name} holds <{root.tag}>, not <robot>; only URDF files are read"
        )
    _check_parts(root, path.name)
    _check_names(root, path.name)
    _check_numbers(root, path.name)
    _check_once(root, path.name)
    return etree.tostring(root, encoding="utf-8")


def _check_parts(root, filename: str) -> None:
    """Refuse a robot, links or joints without a name, and joints without ends."""
    if not root.get("name"):
        raise BadRobot(f'<robot> of {filename} has no name; give it name="my_robot"')
    for part in (*root.findall("link"), *root.findall("joint")):
        if not part.get("name"):
            raise BadRobot(
                f"a <{part.tag}> of {filename}, line {part.sourceline}, has no name; "
                "give it one"
            )
    for joint in root.findall("joint"):
        for end in ("parent", "child"):
            found = joint.find(end)
            if found is None or not found.get("link"):
                raise BadRobot(
                    f"joint {joint.get('name')!r} of {filename} names no {end} link; "
                    f'give it <{end} link="..."/>'
                )


def _check_names(root, filename: str) -> None:
    """Refuse names with a slip: whoever reads over them has another robot."""
    for part in (root, *_parts_of(root, *_PARTS)):
        known = _PARTS[part.tag]
        for tag in [e.tag for e in part if isinstance(e.tag, str)]:
            if tag not in known and (meant := _meant(tag, known)):
                raise BadRobot(
                    f"<{part.tag}> of {filename}, line {part.sourceline}, holds "
                    f"<{tag}>, which a URDF does not know; write <{meant}>"
                )
    for part in _parts_of(root, *_NUMBERS):
        known = (*_NUMBERS[part.tag], *_SHAPES.get(part.tag, ()))
        known += _MORE.get(part.tag, ())
        for key in part.attrib:
            # limits have further ones in many files, of drives and of other programs
            meant = _meant(key, known) if part.tag == "limit" else ", ".join(known)
            if key in known or key.startswith("{") or ":" in key or not meant:
                continue
            if key == "quat_xyzw":
                meant = "rpy, the same turn as roll, pitch and yaw"
            raise BadRobot(
                f"<{part.tag}> of {filename}, line {part.sourceline}, has {key!r}, "
                f"which is not read; write {meant}"
            )


def _meant(name: str, known: Collection[str]) -> str:
    """Return which of the known names one with a slip stands for, "" for none."""
    return next(iter(difflib.get_close_matches(name.lower(), known, 1, _ALIKE)), "")


def _check_once(root, filename: str) -> None:
    """Refuse what holds two things where one is read, and shapes not known."""
    from lxml import etree

    for part in _parts_of(root, *_ONCE):
        for tag in _ONCE[part.tag]:
            where, found = _where(part, filename), part.findall(tag)
            if len({etree.tostring(one, with_tail=False) for one in found}) > 1:
                raise BadRobot(
                    f"{where} holds {len(found)} <{tag}>, of which one would be read; "
                    f"leave one there, and give any other a <{part.tag}> of its own"
                )
            if tag == "geometry" and not found:
                raise BadRobot(f"{where} holds no <geometry>; give it one")
    for part in _parts_of(root, "geometry"):
        # comments have no tag of text; of what is drawn the colour is not read
        shapes = [s for s in part if isinstance(s.tag, str) and s.tag != "material"]
        tags = ", ".join(f"<{shape.tag}>" for shape in shapes)
        if len(shapes) != 1 or shapes[0].tag not in _SHAPES:
            raise BadRobot(
                f"{_where(part, filename)} holds {tags or 'no shape'}; give it a "
                "<box>, <cylinder>, <sphere> or <mesh>, and any other one a "
                f"<{part.getparent().tag}> of its own"
            )
        for key in _SHAPES[shapes[0].tag]:
            if not shapes[0].get(key):
                raise BadRobot(
                    f"{_where(shapes[0], filename)} has no {key}; give it one"
                )


def _parts_of(root, *tags: str) -> list:
    """Return the elements of these tags in links and joints, and those themselves."""
    parts = [*root.findall("link"), *root.findall("joint")]
    return [inner for one in parts for inner in one.iter(*tags)]


def _where(part, filename: str) -> str:
    """Return how messages name an element: its tag, owner, file and line."""
    own = next(p for p in (part, *part.iterancestors()) if p.tag in ("link", "joint"))
    of = "" if own is part else f"of {own.tag} "
    line = f"line {part.sourceline},"
    return f"<{part.tag}> {of}{own.get('name')!r} in {filename}, {line}"


def _check_numbers(root, filename: str) -> None:
    """Refuse what is no number where links and joints have numbers, and degrees."""
    for part in _parts_of(root, *_NUMBERS):
        for key, counts in _NUMBERS[part.tag].items():
            text = part.get(key)
            words = (text or "").split()
            where = (
                f'<{part.tag} {key}="{text}"> of {filename}, line {part.sourceline},'
            )
            for word in words:
                if not is_number(word):
                    raise BadRobot(
                        f"{where} holds {word!r}, which is no number; write numbers "
                        "like 0.5 with blanks between them, and expand xacro files "
                        "first"
                    )
            if counts and text is not None and len(words) not in counts:
                wanted = "three" if 3 in counts else "one"
                raise BadRobot(f"{where} holds {len(words)} numbers; give {wanted}")
            if key == "rpy" and any(abs(float(n)) > MOST_TURNED for n in words):
                raise BadRobot(f"{where} looks like degrees; give radians")
            if part.tag == "mimic" and not all(math.isfinite(float(n)) for n in words):
                raise BadRobot(f"{where} is not finite; give a finite number")


def _is_xacro(tag: str) -> bool:
    """Return whether a tag, "{namespace}name" or "prefix:name", is xacro's."""
    space, _, _ = tag.rpartition("}")
    return tag.startswith("xacro:") or space.rstrip("/").endswith("xacro")


def _checked(model, filename: str) -> Description:
    links = {link.name: _link(link, filename) for link in model.links}
    joints = {joint.name: _joint(joint, filename) for joint in model.joints}
    for what, named in (("link", model.links), ("joint", model.joints)):
        for name, n in Counter(one.name for one in named).items():
            if n > 1:
                raise BadRobot(
                    f"{filename} uses the {what} name {name!r} twice; rename one"
                )
    for joint in joints.values():
        for end in (joint.parent, joint.child):
            if end not in links:
                raise BadRobot(
                    f"joint {joint.name!r} of {filename} names the link {end!r}, "
                    "which the file does not define"
                )
    children = [joint.child for joint in joints.values()]
    roots = [name for name in links if name not in children]
    for child, n in Counter(children).items():
        if n > 1:
            carry = ", ".join(j.name for j in joints.values() if j.child == child)
            raise BadRobot(
                f"the links of {filename} are not one tree: link {child!r} is the "
                f"child of {n} joints ({carry}); every link but one needs exactly one"
            )
    if len(roots) != 1:
        raise BadRobot(
            f"the links of {filename} are not one tree (root links: {roots}); every "
            "link but one needs exactly one parent joint"
        )
    description = Description(str(model.name), roots[0], links, joints)
    _check_connected(description, filename)
    return description


def _check_connected(description: Description, filename: str) -> None:
    carried = {joint.child for joint in description.below(description.root)}
    loose = sorted(set(description.links) - carried - {description.root})
    if loose:
        raise BadRobot(f"the joints of {filename} form a loop through {loose}; cut it")


def _bounded(
    description: Description, filename: str, endless: Collection[str]
) -> Description:
    """Make continuous joints with a range revolute ones, and say so."""
    joints, remarks = dict(description.joints), {}
    for name, joint in joints.items():
        if joint.kind != "continuous":
            continue
        low, high = (None, None) if name in endless else _range(joint, filename)
        kind = "continuous" if low is None else "revolute"
        joints[name] = replace(joint, kind=kind, lower=low, upper=high)
        if low is not None:
            remarks[name] = (
                f"{name}: continuous in the file, but kept within its limits "
                f"{low:.6g} to {high:.6g} rad; take them out where it turns without end"
            )
        elif name not in endless and joint.lower is not None and joint.lower != 0.0:
            remarks[name] = (
                f"{name}: turns without end; its limits {joint.lower:g} to "
                f"{joint.upper:g} rad are too far away to be stops"
            )
    return replace(description, joints=joints, remarks=remarks)


def _range(joint: Joint, filename: str) -> tuple[float, float] | tuple[None, None]:
    """Return the range of a continuous joint, (None, None) where it has no stops.

    0 to 0 is what parsers and exporters write for nothing. A range of a turn or more
    is kept as it is: a cable may well allow two turns and no more.
    """
    low, high = joint.lower, joint.upper
    if (low is None and high is None) or (low == 0.0 and high == 0.0):
        return None, None
    if low is not None and high is not None:
        if low < -NO_STOP and high > NO_STOP:
            return None, None
        if math.isfinite(low) and math.isfinite(high) and low < high:
            return low, high
    raise BadRobot(
        f"the continuous joint {joint.name!r} of {filename} has the limits {low} "
        f"to {high}; give it both, the lower one first, or neither"
    )


def _link(link, filename: str) -> Link:
    return Link(
        link.name,
        tuple(_shape(c, link.name, filename) for c in link.collisions),
        tuple(_shape(v, link.name, filename) for v in link.visuals),
    )


def _shape(element, link: str, filename: str) -> Shape:
    g, name = element.geometry, ""
    if g.box is not None:
        kind, size = "box", g.box.size
    elif g.cylinder is not None:
        kind, size = "cylinder", (g.cylinder.radius, g.cylinder.length)
    elif g.sphere is not None:
        kind, size = "sphere", (g.sphere.radius,)
    else:
        kind, name = "mesh", g.mesh.filename or ""
        scale = 1.0 if g.mesh.scale is None else g.mesh.scale
        size = np.broadcast_to(np.asarray(scale, float), 3)
    scaled = g.mesh is None or g.mesh.scale is not None
    size = tuple(float(s) for s in size)
    pose = _finite_pose(element.origin, f"a shape of link {link!r}", filename)
    wanted = {"box": 3, "cylinder": 2, "sphere": 1, "mesh": 3}[kind]
    bad = len(size) != wanted or not np.isfinite(size).all()
    if bad or (kind != "mesh" and min(size) <= 0) or 0.0 in size:
        raise BadRobot(
            f"link {link!r} of {filename} has a {kind} with the size {size}; sizes "
            "must be finite and above 0"
        )
    return Shape(kind, size, name, pose, scaled)


def _joint(joint, filename: str) -> Joint:
    if joint.type not in (*MOVABLE, "fixed"):
        raise BadRobot(
            f"joint {joint.name!r} of {filename} is of type {joint.type!r}; only "
            "revolute, continuous, prismatic and fixed joints can be planned for: "
            "make it fixed or split it into single axes"
        )
    axis = np.asarray(joint.axis, float)
    length = np.linalg.norm(axis)
    if joint.type in MOVABLE and not 1e-6 < length < 1e6:
        raise BadRobot(
            f"joint {joint.name!r} of {filename} has the axis {axis.tolist()}; it "
            "needs a direction of length 1"
        )
    limit, mimic = joint.limit, joint.mimic
    lower = upper = velocity = None
    if limit is not None:
        lower, upper, velocity = limit.lower, limit.upper, limit.velocity
        _refuse_degrees(joint, filename)
    follows = None
    if mimic is not None and joint.type in MOVABLE:
        follows = (mimic.joint, float(mimic.multiplier), float(mimic.offset))
    return Joint(
        joint.name,
        joint.type,
        joint.parent,
        joint.child,
        _finite_pose(joint.origin, f"joint {joint.name!r}", filename),
        axis / length if length > 0 else np.array([1.0, 0.0, 0.0]),
        lower,
        upper,
        velocity,
        follows,
    )


def _refuse_degrees(joint, filename: str) -> None:
    """Refuse a revolute joint's limits that were written in degrees, for sure."""
    low, high = joint.limit.lower, joint.limit.upper
    for value in (low, high):
        turned = joint.type == "revolute" and value is not None
        if turned and MOST_TURNED < abs(value) <= MOST_DEGREES:
            raise BadRobot(
                f"joint {joint.name!r} of {filename} has the limits {low} to {high} "
                "rad, more than three turns, which looks like degrees; give radians, "
                "or make it continuous where it turns so far"
            )


def _finite_pose(pose: np.ndarray | None, owner: str, filename: str) -> np.ndarray:
    pose = np.eye(4) if pose is None else np.asarray(pose, float)
    if not np.isfinite(pose).all():
        raise BadRobot(f"the origin of {owner} in {filename} is not finite; repair it")
    return pose
