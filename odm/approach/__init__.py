"""The last centimetres: a straight tool motion, proved by the close test."""
