"""A whole person beside the robot: a body of capsules, named in what the planner says.

python docs/examples/05_a_whole_person.py [MAP]
"""

import importlib

import numpy as np

import odm
import roadmap
from handover import Human

plan_once = importlib.import_module("01_plan_once")


def main(cell_map: odm.CellMap) -> list[odm.Answer]:
    """Let a person come nearer, and tell what the planner makes of it."""
    planner = odm.ReactivePlanner(cell_map)
    start, goal = plan_once.two_places(planner)
    planner.set_goals([goal])
    person, answers = Human(height=1.75), []
    for distance in (1.5, 1.0, 0.6):  # of the pelvis from the base, along x [m]
        body = person.placed(distance, 0.0, np.pi).obstacles()
        answer = planner.step(body, q=start)
        gap = 100 * planner.separation(start)
        print(
            f"{distance:.1f} m: {answer.status}, the nearest part is {gap:.0f} cm away"
        )
        if answer.status == "holding":
            print("  ", answer.reason)
        answers.append(answer)

    # where the hand of a person can be who would take something here
    tool = roadmap.tool_pose(cell_map.robot, goal)
    print(f"the tool's goal is at {tool[:3, 3].round(2)} m in the robot's base frame")
    return answers


if __name__ == "__main__":
    main(plan_once.the_map())
