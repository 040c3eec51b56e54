"""The contract of grippers as checks. `cobot gripper test NAME` runs them.

suite       all gripper checks and their results
new         `cobot gripper new`: writes a package with a working gripper
toy         a complete driver with a toy device, which `cobot gripper new` copies into the package
"""
