"""A hand-over plan played from its file: who does what, and a film of it."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from handover.scenes.agent_body import AgentBody, agent_body
from handover.scenes.plan_file import WHO, duration, read_plan, read_shape
from handover.scenes.scene import Fixture
from odm.obstacles.shapes import Shape
from roadmap.errors import BadInput


@dataclass(frozen=True, eq=False)
class PlannedAgent:
    """An agent of a plan's file: its URDF, where its base stands (4, 4) [m]."""

    body: AgentBody
    T_world_base: np.ndarray

    def shapes(self, joints: Mapping[str, float]) -> list[tuple[str, Shape]]:
        """Return its solids as (link, shape in the world frame)."""
        return self.body.shapes(joints, self.T_world_base)

    def link_pose(self, link: str, joints: Mapping[str, float]) -> np.ndarray:
        """Return T_world_link, (4, 4) [m]."""
        return self.T_world_base @ self.body.frames(joints)[link]


@dataclass(frozen=True, eq=False)
class PlayedPlan:
    """What a plan's file says stands and moves; no scene is drawn anew for it."""

    record: Mapping  # the file, see `handover.scenes.plan_file`
    # both agents
    giver: PlannedAgent
    receiver: PlannedAgent
    scenery: tuple[Fixture, ...]  # furniture and floor

    def object_shapes(self, T_world_object: np.ndarray) -> list[Shape]:
        """Return the object's parts at a pose (4, 4), world frame [m]."""
        parts = self.record["object"]["parts"]
        return [read_shape(entry).moved(T_world_object) for entry in parts]

    def facts(self) -> dict:
        """Return who does what and when [s], as plain data."""
        return {
            "scene": self.record["scene"]["name"],
            "duration_s": round(duration(self.record), 3),
            "motions": [
                {"name": m["name"], "who": m["who"], "begin": round(m["times"][0], 3),
                 "end": round(m["times"][-1], 3)}
                for m in self.record["motions"]
            ],
            "holds": [
                {"who": h["who"], "link": h["link"], "begin": h["begin"],
                 "end": h["end"]}
                for h in self.record["holds"]
            ],
        }  # fmt: skip


def read_played(path: str | Path) -> PlayedPlan:
    """Read a plan and the agents that it names.

    Raises:
        BadInput: No plan, an entry that playing it needs is missing or wrong, a URDF
            that is not there, or joints and links that it does not have.
    """
    record = read_plan(path)
    try:
        agents = [_planned_agent(record, who) for who in WHO]
        named = [(e["name"], read_shape(e)) for e in record["scenery"]]
        played = PlayedPlan(record, *agents, tuple(Fixture(*each) for each in named))
        played.object_shapes(np.eye(4))
        played.facts()
    except KeyError as error:
        raise BadInput(
            f"the plan {path} lacks {error}; make it again with `odm handover plan "
            "SCENE --json FILE`"
        ) from error
    return played


def _planned_agent(record: Mapping, who: str) -> PlannedAgent:
    agent = record[who]
    file = Path(agent["urdf"])
    if not file.is_file():
        raise BadInput(
            f"the URDF {file} of the plan's {agent['name']} is not there; put it there "
            "or make the plan again"
        )
    body, whose = agent_body(str(file)), f"the plan's {agent['name']}"
    body.checked(agent["joints"], whose)
    for joint in body.joints:
        if joint not in agent["joints"]:
            raise BadInput(f"{whose} lacks joint {joint!r}; add it")
    for hold in record["holds"]:
        if hold["who"] == who and hold["link"] not in body.links:
            raise BadInput(f"{whose} has no link {hold['link']!r}; correct the holds")
    return PlannedAgent(body, np.array(agent["T_world_base"], float))


def show_played(told: dict) -> None:
    """Print who does what, and what holds the object, of `PlayedPlan.facts`."""
    print(f"plan of {told['scene']}, {told['duration_s']:.1f} s")
    for row in told["motions"]:
        print(
            f"  {row['begin']:7.2f} to {row['end']:7.2f} s  {row['who']:8} "
            f"{row['name']}"
        )
    for row in told["holds"]:
        end = told["duration_s"] if row["end"] is None else row["end"]
        held = f"is held by the {row['who']}, {row['link']}"
        what = held if row["link"] else "stands by itself"
        print(f"  {row['begin']:7.2f} to {end:7.2f} s  the object {what}")
    if "animation" in told:
        print(f"animation in {told['animation']}")
