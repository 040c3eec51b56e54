-- The ROS 2 side in one page: say something on a topic, wait a second for an answer on another one.
--     cobot lua examples/hello.lua
-- From the other end, with any ROS 2 node or rosbridge client, publish a std_msgs/msg/String on /demo/from_ros.
local ros_bind = require("ros_bind")

local pub = ros_bind.ros_publisher_factory("/demo/from_lua", "std_msgs/msg/String")
local sub = ros_bind.ros_subscriber_factory("/demo/from_ros", "std_msgs/msg/String")

pub:write("hello from lua")

local ok, msg = sub:read_timeout(1000)
if ok then
  textmsg("recv:", msg)
else
  textmsg("timeout")
end
