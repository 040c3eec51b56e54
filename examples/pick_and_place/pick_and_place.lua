-- Picks the cube, carries it through the light barrier, and places it in the tray by touch. Start
-- `cobot run --cell examples/pick_and_place` in another terminal, then:
--     .venv/bin/cobot lua examples/pick_and_place/pick_and_place.lua
-- Lengths in m, angles in rad, forces in N. b = pi: the hand points down.
local function down_at(x, y, z, how)
  how.x, how.y, how.z, how.b = x, y, z, math.pi
  return how
end

local function line(x, y, z, speed_m_s)
  move(down_at(x, y, z, { planner = "lin", speed_m_s = speed_m_s }))
end

move_named("home", 0.5)
gripper.release {}
move(down_at(0.5, -0.3, 0.36, { speed = 0.5 })) -- above the cube
line(0.5, -0.3, 0.225, 0.1)
gripper.grasp { width = 0.05, force = 40 }
line(0.5, -0.3, 0.36, 0.1)
line(0.5, 0.12, 0.36, 0.3) -- the cube interrupts the light barrier, the fingers are above it
wait_for({ input = "gate", is = true }, 2)
line(0.55, 0.3, 0.36, 0.3) -- above the tray
move(down_at(0.55, 0.3, 0.22, {
  planner = "lin",
  speed_m_s = 0.03,
  ["until"] = { force = { direction = { x = 0, y = 0, z = 1 }, threshold = 10 } },
}))
gripper.release {}
line(0.55, 0.3, 0.5, 0.1)
move_named("home", 0.5)
textmsg("the cube is in the tray")
