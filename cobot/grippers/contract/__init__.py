"""The contract of grippers as checks: run them with `cobot gripper test NAME`.

suite       all checks of a gripper, and their results
new         `cobot gripper new`: a package with a gripper that works
toy         a complete driver with a toy device, which `cobot gripper new` makes a package of
"""
