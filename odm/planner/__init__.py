"""ReactivePlanner: what it is told, what it answers, and what it remembers."""
