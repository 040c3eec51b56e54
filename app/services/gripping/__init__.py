"""The gripper of a robot.

service     commands as jobs, one at a time; a new command replaces the current one
commands    running commands and their results
following   waiting for the end of a command
checks      validation of requests
held        attaches and detaches the object between the fingers in the scene
"""
