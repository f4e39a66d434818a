"""Paths in time: blended corners, jerk-limited timing, joins and stops."""
