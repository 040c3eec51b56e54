"""Robot description files for `cobot new-robot`: reading URDF and MJCF, and saving model.xml.

xml_file reads XML with its encoding and line numbers; urdf and mjcf turn it into a MuJoCo specification;
tree finds grippers and linkages, and arm the chain of joints to be moved; joints leaves out all others;
meshes collects the shapes; saving compiles and writes model.xml.
"""
