"""People that move: scripted, recorded or whole, as closed capsules."""
