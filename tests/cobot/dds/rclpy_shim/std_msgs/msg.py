"""std_msgs.msg, as far as the manual's client goes."""

from rclpy.types import message

String = message("std_msgs/msg/String")
