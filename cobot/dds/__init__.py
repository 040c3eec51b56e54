"""The DDS side of the service, with which ROS 2 nodes communicate."""
