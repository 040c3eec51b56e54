"""The DDS side of the service: what ROS 2 nodes talk to."""
