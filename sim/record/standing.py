"""What stands around a run, as plain data of its recording."""

from dataclasses import fields

import numpy as np

from odm import Box, Capsule, Cylinder, Mesh, ReactivePlanner, Sphere
from odm.obstacles.surfaces import Surface
from roadmap.errors import BadInput
from sim.record.record_check import BadRecord

_KINDS = {kind.__name__: kind for kind in (Box, Capsule, Cylinder, Mesh, Sphere)}


def scene_rows(planner: ReactivePlanner) -> list[dict]:
    """Return the objects of a planner's scene as plain data; points are refused."""
    rows = []
    for name in planner.scene:
        thing = planner.scene[name]
        if any(isinstance(part, Surface) for part in thing.parts):
            raise BadInput(
                f"{name!r} of the scene is a surface of points, which a recording does "
                "not hold; give its shape, or run without a recording"
            )
        parts = [
            {"kind": type(part).__name__}
            | {f.name: _plain(getattr(part, f.name)) for f in fields(part)}
            for part in thing.parts
        ]
        rows.append(
            {"name": name, "pose": thing.T_world_object.tolist(), "parts": parts}
        )
    return rows


def set_up(planner: ReactivePlanner, rows: list[dict]) -> None:
    """Let the recorded objects stand around a planner's robot."""
    for row in rows:
        name, shapes, pose = shapes_of(row)
        try:
            planner.scene.add(name, shapes, pose)
        except BadInput as error:
            raise BadRecord(f"the recorded scene cannot be set up: {error}") from error
    planner.scene.test_waiting()


def shapes_of(row: dict) -> tuple[str, list, np.ndarray]:
    """Return name, shapes and (4, 4) pose of a recorded object."""
    try:
        shapes = [
            _KINDS[part["kind"]](**{k: v for k, v in part.items() if k != "kind"})
            for part in row["parts"]
        ]
        return str(row["name"]), shapes, np.array(row["pose"], float)
    except (BadInput, KeyError, TypeError, ValueError, AttributeError) as error:
        raise BadRecord(
            f"the recorded scene holds what is no object ({error}); record again"
        ) from error


def _plain(value: object) -> object:
    return value.tolist() if isinstance(value, np.ndarray) else value
