"""Planning and inverse kinematics: success, time, and the quality of motions."""
