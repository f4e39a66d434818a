"""Robots of any size, with joints of every kind, and recipes, drawn at random."""

from pathlib import Path

import numpy as np

from odm.cell_map.recipe import PayloadRecipe, Recipe, RobotRecipe
from odm.close_test.safety import Safety
from roadmap.graph.connecting import RoadmapSettings

SIZES = (0.05, 0.25, 1.0)  # [m] of a link


def draw_recipe(folder: Path, seed: int) -> Recipe:
    """Return the recipe of a quick map of a drawn robot, whose file is put in a folder.

    Its margins suit the robot's size, but for the user's share of the clearance, which
    may be more than 10 cm.
    """
    rng = np.random.default_rng(seed)
    link = float(rng.choice(SIZES))
    path = folder / f"drawn{seed}.urdf"
    path.write_text(_urdf(rng, link))
    rho = max(0.1 * link * float(rng.choice([0.3, 1.0])), 0.004)
    far = rng.normal(size=3)
    at = 2.5 * link * far / np.linalg.norm(far)
    box = {
        "type": "box",
        "name": "box",
        "size": (link * rng.uniform(0.2, 1.0, 3)).tolist(),
    }
    ball = {"type": "sphere", "name": "ball", "radius": 0.3 * link}
    stands = {**(box if rng.random() < 0.5 else ball), "position": at.tolist()}
    payload = PayloadRecipe(radius=0.4 * link, position=(0.0, 0.0, 0.2 * link))
    return Recipe(
        f"drawn{seed}",
        RobotRecipe(str(path), tip="tool", cover_excess=max(0.15 * link, 0.005)),
        RoadmapSettings(nodes=40, neighbors=4, seed=seed),
        Safety(
            h=0.25 * link, rho=rho, mu=0.05 * link, user=float(rng.choice([0.0, 0.1]))
        ),
        (stands,) if rng.random() < 0.6 else (),
        payload if rng.random() < 0.4 else None,
    )


def _urdf(rng: np.random.Generator, size: float) -> str:
    """Return the URDF of a chain of 2 to 4 links, some with fingers or another arm."""
    turned = " ".join(map(str, rng.choice([0.0, np.pi / 2, 1.0], 3)))
    parts = [
        '<robot name="drawn"><link name="root"/><link name="base"/>',
        _joint("mount", "fixed", "root", "base", f'xyz="0 0 {size}" rpy="{turned}"'),
    ]
    parent, leads = "base", ""
    for k in range(int(rng.integers(2, 5))):
        kind = str(rng.choice(["revolute", "revolute", "continuous", "prismatic"]))
        low, high = rng.uniform(-3.0, -0.5), rng.uniform(0.5, 3.0)
        if kind == "prismatic":
            low, high = 0.2 * size * low, 0.5 * size * high
        more = f'<axis xyz="{rng.choice(["0 0 1", "0 1 0", "1 0 0", "1 2 -1"])}"/>'
        limits = "" if kind == "continuous" else f'lower="{low}" upper="{high}" '
        more += f'<limit {limits}velocity="{2.0 * size}" effort="1"/>'
        if leads and rng.random() < 0.2:
            more += f'<mimic joint="{leads}" multiplier="-0.5" offset="0.1"/>'
        else:
            leads = f"joint{k}"
        name, at = f"link{k}", f'xyz="0 {size * rng.choice([0.0, 0.3])} {1.1 * size}"'
        parts.append(_link(name, _solid(rng, size), 0.5 * size))
        parts.append(_joint(f"joint{k}", kind, parent, name, at, more))
        parent = name
    parts.append('<link name="tool"/>')
    parts.append(_joint("grip", "fixed", parent, "tool", f'xyz="0 0 {size}"'))
    if rng.random() < 0.4:
        for name, side in (("finger", 1), ("other", -1)):
            box = f'<box size="{0.1 * size} {0.1 * size} {0.3 * size}"/>'
            more = f'<axis xyz="0 {side} 0"/><limit lower="0" upper="{0.2 * size}" '
            more += 'velocity="1" effort="1"/>'
            more += '<mimic joint="move_finger"/>' if side < 0 else ""
            at = f'xyz="0 {0.06 * side * size} {size}"'
            parts.append(_link(name, box, 0.15 * size))
            parts.append(_joint(f"move_{name}", "prismatic", parent, name, at, more))
    if rng.random() < 0.3:
        more = (
            '<axis xyz="0 1 0"/><limit lower="-1" upper="1" velocity="1" effort="1"/>'
        )
        at = f'xyz="0 {2.0 * size} 0"'
        parts.append(_link("arm", _solid(rng, size), 0.5 * size))
        parts.append(_joint("shoulder", "revolute", "base", "arm", at, more))
    return "".join([*parts, "</robot>"])


def _solid(rng: np.random.Generator, size: float) -> str:
    thick, long = size * rng.uniform(0.15, 0.3), size * rng.uniform(0.5, 1.0)
    return str(
        rng.choice(
            [
                f'<box size="{thick} {1.5 * thick} {long}"/>',
                f'<cylinder radius="{0.6 * thick}" length="{long}"/>',
                f'<sphere radius="{thick}"/>',
            ]
        )
    )


def _link(name: str, solid: str, up: float) -> str:
    return (
        f'<link name="{name}"><collision><origin xyz="0 0 {up}"/>'
        f"<geometry>{solid}</geometry></collision></link>"
    )


def _joint(
    name: str, kind: str, parent: str, child: str, origin: str, more: str = ""
) -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/>'
        f'<child link="{child}"/><origin {origin}/>{more}</joint>'
    )
