"""A person: measures, joints, arms, postures and the capsules of the body."""
