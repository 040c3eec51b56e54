"""`cobot new-robot`: makes a configuration from a robot's description file.

new_robot writes the folder; masses, inertials and volumes determine the masses of the links; efforts judges
the drives; home_posture chooses the positions; srdf_import takes over an SRDF; guesses fills in what files
leave out. The files themselves are read by `cobot.launch.robot_file`.
"""
