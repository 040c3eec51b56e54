"""The part of the service that speaks DDS, with which ROS 2 nodes communicate."""
