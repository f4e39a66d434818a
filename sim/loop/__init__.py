"""The kinematic loop of person, planner and robot, and what happened in it."""
