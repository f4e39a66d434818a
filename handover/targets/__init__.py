"""From meeting places to goals of the planner, frame by frame."""
