"""The loop of person, planner and robot, frame by frame, and what happened in it."""
