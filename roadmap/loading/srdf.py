"""Pairs of links that an SRDF declares not to need a collision test."""

import os

from roadmap.errors import BadRobot
from roadmap.ranges import check_path
from roadmap.robot.description import read_xml


def read_disabled_pairs(path: str | os.PathLike) -> dict[frozenset[str], str]:
    """Return {links: reason} of the <disable_collisions> of an SRDF file."""
    path = check_path("an SRDF file", path)
    if path.is_dir():
        raise BadRobot(f"{path} is a folder; name the SRDF in it, or leave it out")
    if not path.is_file():
        raise BadRobot(
            f"there is no SRDF file at {str(path)!r}; give the path of one, or leave "
            "it out"
        )
    root = read_xml(path)
    if root.tag != "robot":
        raise BadRobot(
            f"{path.name} holds <{root.tag}>, not the <robot> of an SRDF; "
            "give one, or leave it out"
        )
    if root.find("link") is not None or root.find("joint") is not None:
        raise BadRobot(
            f"{path.name} is a URDF, with links and joints of its own; give the SRDF "
            "beside it, or leave it out"
        )
    pairs = {}
    for element in root.iter("disable_collisions"):
        links = frozenset((element.get("link1", ""), element.get("link2", "")))
        pairs[links] = element.get("reason", "no reason given")
    return pairs
