"""Whole hand-overs: arm, grasps, pose and proved motions of two agents."""
