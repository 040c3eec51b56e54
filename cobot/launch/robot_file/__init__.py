"""Robot description files for `cobot new-robot`: reading URDF and MJCF, and saving model.xml.

xml_file reads XML with its encoding and line numbers; urdf and mjcf turn it into a MuJoCo specification;
joints leaves out what does not move; meshes collects the shapes; saving compiles and writes model.xml.
"""
