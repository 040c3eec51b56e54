"""The gripper of a robot.

service     commands as jobs: one at a time, a new one replaces the one before
commands    while they are under way, and what they have come to
following   waiting for the end of a command
checks      what a gripper can be asked for
held        what is between the fingers: attached and detached in the scene
"""
