"""`cobot new-robot`: makes a configuration from a robot's description file.

The module new_robot writes the folder. The modules masses, inertials and volumes determine the masses of the
links. efforts judges the drives, and home_posture chooses the positions. srdf_import uses the data in an
SRDF, and guesses finds values that are missing in the files. The package `cobot.launch.robot_file` reads the
files.
"""
