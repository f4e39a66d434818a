"""What a robot is: its frozen arrays, and what URDF, SRDF and users say of it."""
