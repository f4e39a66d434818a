"""Attempts to falsify a map or a planner by exact geometry."""
