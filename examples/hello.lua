-- Publishes a joint position in ROS 2, and waits for a name from there. Start `make run` in another terminal, then:
--     .venv/bin/cobot lua examples/hello.lua
-- Then publish a std_msgs/msg/String on /demo/name, with any ROS 2 node or rosbridge client.
local ros = require("ros_bind")
local names = ros.ros_subscriber_factory("/demo/name", "std_msgs/msg/String")
local joint4 = ros.ros_publisher_factory("/demo/joint4", "std_msgs/msg/Float64")

joint4:write(get_joint_positions()[4]) -- rad
local came, name = names:read_timeout(2000) -- ms
textmsg("hello", came and name or "no answer")
