"""The example of docs/layers.md runs as it stands, its recipes are recipes."""

import re
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
from small import AWAY, HOME, NOBODY, small_recipe

import odm
from odm.cell_map.recipe import PayloadRecipe, parse_recipe

DOC = Path(__file__).resolve().parents[3] / "docs" / "layers.md"


def test_the_example_runs():
    text = DOC.read_text(encoding="utf-8")
    code = re.search(r"```python\n(.*?)```", text, re.S).group(1)
    envelope = PayloadRecipe(radius=0.1)
    cell_map = odm.build_map(replace(small_recipe(), payload=envelope))
    planner = odm.ReactivePlanner(cell_map)
    planner.set_goals([0.5 * AWAY])
    known = {
        "odm": odm,
        "np": np,
        "planner": planner,
        "T_tool_object": np.eye(4),
        "points": NOBODY,
        "q_now": 0.5 * HOME,
    }
    exec(code, known)
    assert known["answer"].status == "replanned"
    assert planner.attached is None


def test_the_recipes_are_recipes():
    text = DOC.read_text(encoding="utf-8")
    whole = "\n".join(re.findall(r"```toml\n(.*?)```", text, re.S))
    recipe = parse_recipe(tomllib.loads(whole), "doc")
    assert recipe.payload.radius == 0.1
    assert recipe.robot.travel is None  # as the doc says: nothing needs saying
