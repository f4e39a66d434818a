"""Benches of the map, the planner and the loop."""
