"""Everything that moves, draws or talks to a user: loop, person, pictures, tables."""
