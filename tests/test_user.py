"""What a user writes passes a type checker, and what they look at is short."""

import os

import pytest
from command_line import ROOT

SCRIPT = """
import numpy as np
import odm, roadmap

cell_map = odm.load_map("map")
planner = odm.ReactivePlanner(cell_map)
nodes = cell_map.roadmap.nodes
planner.set_goals([nodes[-1]])
planner.set_goals(nodes[:2], costs=[0.0, 1.0])
planner.set_goals([[0.0, 0.0, 0.0]])
planner.set_goals(poses=np.eye(4)[None])
person = odm.Obstacles(capsules=np.zeros((17, 7)))
answer = planner.step(person, q=nodes[0], stamp=0.1, now=0.2)
planner.scene.add("crate", odm.Box((0.3, 0.2, 0.2)))
planner.evasion(nodes[0], [(0.1, person), (0.2, np.zeros((0, 3)))], 0.5)
motion = roadmap.time_path(cell_map.robot, answer.path)
q: np.ndarray = motion.at(0.1).q
odm.Box("large").size.upper()
"""
# a user's own settings; what our doors do not hand out is not read
SETTINGS = """
[mypy]
follow_imports = silent
ignore_missing_imports = true
strict = true
[mypy-numba.*,trimesh.*,rich.*,typer.*,PIL.*,pydantic.*,markdown_it.*]
follow_imports = skip
"""


def test_a_users_script_passes_and_a_mistake_of_it_does_not(tmp_path):
    mypy = pytest.importorskip("mypy.api")
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    files = [str(script), *map(str, (ROOT / "docs" / "examples").glob("0*.py"))]
    (tmp_path / "mypy.ini").write_text(SETTINGS)
    how = ["--config-file", str(tmp_path / "mypy.ini"), "--cache-dir", os.devnull]
    told = mypy.run([*how, *files])[0]
    lines = [line for line in told.splitlines() if ": error:" in line]
    assert len(files) > 7 and len(lines) == 1 and '"upper"' in lines[0], told


def test_what_a_user_looks_at_is_told_in_a_line(planner):
    import handover
    from odm import Obstacles
    from roadmap import time_path

    cell_map, robot = planner.cell_map, planner.robot
    motion = time_path(robot, cell_map.roadmap.nodes[:2])
    seen = [cell_map, robot, cell_map.roadmap, planner, planner.scene, motion]
    seen += [handover.Human(), handover.wrench(), Obstacles(spheres=[[0, 0, 0, 1]])]
    for one in seen:
        told = repr(one)
        assert told.startswith(type(one).__name__), told
        assert len(told) < 1500 and "\n" not in told and " at 0x" not in told, told
