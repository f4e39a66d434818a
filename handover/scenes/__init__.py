"""Scenes of a hand-over: both agents, the object with start and goal, furniture."""
