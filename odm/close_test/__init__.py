"""Whether a motion keeps its distance: its spheres against points and scenery."""
