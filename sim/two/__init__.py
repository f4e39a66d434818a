"""Two robots in one space, each in the way of the other."""
