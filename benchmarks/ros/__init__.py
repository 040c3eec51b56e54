"""ROS 2 and ros2_control."""
