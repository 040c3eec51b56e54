-- A pick without a gripper: move above the part, straight down, up again, and home. Start `make run` in another
-- terminal, then:
--     .venv/bin/cobot lua examples/pick.lua
-- Lengths in m, angles in rad: a pose is {x, y, z, rx, ry, rz}.
local ros_bind = require("ros_bind")
local events = ros_bind.ros_publisher_factory("/demo/pick", "std_msgs/msg/String")

local FAST, SLOW = 0.5, 0.1
local LIFT = 0.15 -- height above the part where the arm arrives and leaves, m

local function over(pose, height)
  local x, y, z, rx, ry, rz = table.unpack(pose)
  return { x, y, z + height, rx, ry, rz }
end

local function pick(part)
  movel(over(part, LIFT), FAST)
  movel(part, SLOW)
  events:write("picked")
  movel(over(part, LIFT), FAST)
end

movej({ 0, 0.4, 0, -1.57, 0, 1.2, 0 }, FAST)
local here = get_tcp_pose()
local part = over(here, -LIFT)

local ok, reason = pcall(pick, part)
if not ok then
  textmsg("no pick:", reason) -- for example: out of reach, or a stop
end
move_named("home", FAST)
textmsg("at home, joint 4 at", get_joint_positions()[4])
