"""`cobot new-robot`: what it makes of a description file.

new_robot makes the folder; masses, inertials and volumes settle the masses of the links; efforts judges the
drives; home_posture chooses the positions; srdf_import takes over an SRDF; guesses fills in what files leave
out. The files themselves are read by `cobot.launch.robot_file`.
"""
