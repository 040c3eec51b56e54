"""Robot description files for `cobot new-robot`: reading URDF and MJCF, and saving model.xml.

The module xml_file reads XML with its encoding and line numbers. The modules urdf and mjcf turn it into a
MuJoCo specification. tree finds grippers and linkages, and arm finds the chain of joints that will move.
joints removes all other joints. meshes collects the shapes. saving compiles and writes model.xml.
"""
