"""The gripper of a robot.

service     commands as jobs: one at a time, a new one replaces the one before
commands    running commands and their results
following   waiting for the end of a command
checks      validation of requests
held        the object between the fingers: attached and detached in the scene
"""
