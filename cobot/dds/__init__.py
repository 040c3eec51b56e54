"""The part of the service that speaks DDS, the protocol of ROS 2 nodes."""
