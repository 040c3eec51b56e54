-- What stands between a program and the Lua runtime: run once, with the real globals. Gives the function that
-- runs a program's text in an environment of its own. All that the program can reach are plain values, tables
-- and Lua functions: no object of Python's, no `debug`, `io`, `os`, `package` and `load`.
local host, poll, interval = ...
-- host: table of Python functions, which never raise but give true and the results, or false and the reason.
-- poll(instructions): counts, and gives the reason for which the program has to end, or nothing.

local error, pcall, rawget, setmetatable, type, select = error, pcall, rawget, setmetatable, type, select
local load, sethook, string, table, coroutine = load, debug.sethook, string, table, coroutine
local insert, concat, tostring = table.insert, table.concat, tostring
local pack, unpack = table.pack, table.unpack
local create, resume = coroutine.create, coroutine.resume
local stopped -- the reason, from when the program has to end

local function ended(...) -- the results of all that catches errors pass here: nothing catches the end
  if stopped then error(stopped, 0) end
  return ...
end

local function count(instructions, level)
  local reason, place = poll(instructions)
  if not reason then return end
  if place then reason = select(2, pcall(error, reason, level + 1)) end
  stopped = reason
  error(reason, 0)
end

local function hook() count(interval, 3) end -- 3: what the program was doing

local function outcome(ok, ...)
  if ok then return ... end
  local reason, final = ...
  if final then stopped = reason end
  error(reason, final and 0 or 2)
end

local function exported(name) -- tail calls, so that level 2 in `outcome` is the line of the program
  local call = host[name]
  return function(...)
    ended()
    return outcome(call(...))
  end
end

local env = {}
for _, name in ipairs {
  "_VERSION", "assert", "error", "getmetatable", "ipairs", "next", "pairs", "rawequal", "rawget", "rawlen",
  "rawset", "select", "tonumber", "tostring", "type", "math", "string", "table", "utf8",
} do
  env[name] = _G[name]
end
env._G = env
string.dump = nil

function env.pcall(...) return ended(pcall(...)) end

-- The original runs its handler where the error is raised: in a hook, where no second hook can end it.
local function handled(handler, ok, ...)
  if ok then return true, ... end
  return false, handler(...)
end
function env.xpcall(f, handler, ...)
  if type(handler) ~= "function" then error("xpcall needs a function as its second argument", 2) end
  return handled(handler, ended(pcall(f, ...)))
end

function env.setmetatable(object, metatable)
  if type(metatable) == "table" and rawget(metatable, "__gc") ~= nil then
    error("a metatable cannot have __gc here: a finalizer could not be ended", 2)
  end
  return setmetatable(object, metatable)
end

-- A hook belongs to one coroutine, so each gets its own.
local function new(f)
  local made = create(f)
  sethook(made, hook, "", interval)
  return made
end
local function resumed(made, ...)
  count(100, 3)
  return ended(resume(made, ...))
end
local function unwrapped(ok, ...)
  if ok then return ... end
  error((...), 0)
end
env.coroutine = {
  create = new,
  resume = resumed,
  wrap = function(f)
    local made = new(f)
    return function(...) return unwrapped(resumed(made, ...)) end
  end,
  isyieldable = coroutine.isyieldable,
  running = coroutine.running,
  status = coroutine.status,
  yield = coroutine.yield,
}

local function words(...)
  local texts = {}
  for index = 1, select("#", ...) do texts[index] = tostring((select(index, ...))) end
  return concat(texts, " ")
end
local textmsg = exported("textmsg")
function env.textmsg(...) return textmsg(words(...)) end
env.print = env.textmsg

for name in pairs(host) do
  if name:match("^program_") then env[name:sub(9)] = exported(name) end
end
env.movej, env.movel, env.movec = env.moveJoint, env.moveLine, env.moveCircle
env.get_joint_positions, env.get_tcp_pose = env.getJointPositions, env.getTcpPose

-- robot.call("Class", "method", {...}), or robot.Class.method({...})
local call = exported("call")
env.robot = setmetatable({ call = call }, {
  __index = function(_, class)
    return setmetatable({}, {
      __index = function(_, method)
        return function(arguments) return call(class, method, arguments) end
      end,
      __metatable = false,
    })
  end,
  __metatable = false,
})

local function object(methods) return setmetatable({}, { __index = methods, __metatable = false }) end
local function opened(make, ok, handle, ...)
  if ok then return make(handle) end
  return outcome(ok, handle, ...)
end
local function publisher(handle)
  return object {
    write = function(_, value) ended() return outcome(host.publish(handle, value)) end,
    close = function() ended() return outcome(host.close(handle)) end,
  }
end
local function subscriber(handle)
  return object {
    read = function() ended() return outcome(host.take(handle)) end,
    read_timeout = function(_, ms) ended() return outcome(host.take(handle, ms or 0)) end,
    close = function() ended() return outcome(host.close(handle)) end,
  }
end

-- gripper.grasp { width = 0.04 }
env.gripper = {}
for _, name in ipairs { "move", "grasp", "release", "home", "stop" } do
  env.gripper[name] = function(how) ended() return outcome(host.gripper(name, how)) end
end

-- for place in pallet(origin, counts, offsets) do move(place:at { z = -0.1 }) end
local function place_of(pose)
  local place = object {
    at = function(_, relative) ended() return outcome(host.place_at(pose, relative)) end,
  }
  place.number = pose.number
  return place
end
local function each_place(found)
  local number = 0
  return function()
    number = number + 1
    if found[number] then return place_of(found[number]) end
  end
end
function env.pallet(...) ended() return opened(each_place, host.places(...)) end

-- on_error(work, { retry = 2, run = function(reason) ... end, go_on = true }): the results of work
local options_of_on_error = { retry = true, run = true, go_on = true }
local function packed(ok, ...) return ok, pack(...) end
function env.on_error(work, options)
  options = options or {}
  if type(work) ~= "function" or type(options) ~= "table" then
    error("on_error takes a function, and a table of options", 2)
  end
  for name in pairs(options) do
    if not options_of_on_error[name] then
      error("the options of on_error are retry, run and go_on; got " .. tostring(name), 2)
    end
  end
  local valid, retry = host.require_retry(options.retry or 0)
  if not valid then error(retry, 2) end
  for attempt = 0, retry do
    local ok, results = packed(env.pcall(work))
    if ok then return unpack(results, 1, results.n) end
    local reason = results[1]
    if not outcome(host.is_recoverable(reason)) then error(reason, 0) end
    if options.run then options.run(reason) end
    if attempt == retry and not options.go_on then error(reason, 0) end
  end
end

local ros_bind = {}
function ros_bind.ros_publisher_factory(...) ended() return opened(publisher, host.advertise(...)) end
function ros_bind.ros_subscriber_factory(...) ended() return opened(subscriber, host.subscribe(...)) end
function env.require(name)
  if name == "ros_bind" then return ros_bind end
  error("there is no module '" .. tostring(name) .. "' here; valid is: ros_bind", 2)
end

return function(source, name)
  local program, reason = load(source, name, "t", env)
  if not program then return nil, reason end
  sethook(hook, "", interval)
  local ok, problem = pcall(program)
  sethook()
  if ok then return true end
  if type(problem) ~= "string" then problem = "the program ended with an error that is not a text: " .. type(problem) end
  return false, problem
end
