"""Where a robot's points are and how far they move; joints that reach a pose."""
