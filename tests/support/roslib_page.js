// What npm's roslib sees of a running service, in a page that comes from it. ROSLIB is in the page already.
async (robot) => {
  const ros = new ROSLIB.Ros({ url: `ws://${location.host}/rosbridge` });
  await new Promise((resolve, reject) => { ros.on("connection", resolve); ros.on("error", reject); });
  const topic = new ROSLIB.Topic({ ros, name: `/${robot}/joint_states`, messageType: "sensor_msgs/msg/JointState" });
  const state = await new Promise((resolve) => topic.subscribe(resolve));
  topic.unsubscribe();
  const call = (name, type, request) => new Promise((resolve) =>
    new ROSLIB.Service({ ros, name, serviceType: type }).callService(request, resolve, (error) => resolve({ error })));
  const dof = await call(`/${robot}/RobotConfig/getDof`, "aubo_interfaces/srv/GetDof", {});
  const wrong = await call(`/${robot}/RobotConfig/getDof`, "aubo_interfaces/srv/GetDof", { x: 1 });
  const topics = await new Promise((resolve, reject) => ros.getTopics(resolve, reject));
  const action = new ROSLIB.Action({ ros, name: `/${robot}/servo_mode`, actionType: "aubo_interfaces/action/ServoMode" });
  let goal, feedback;
  const result = await new Promise((resolve) => {  // to roslib a goal that was cancelled is one that failed
    goal = action.sendGoal({ mode: 1, watchdog_timeout: 20 }, resolve,
      (values) => { feedback = values; action.cancelGoal(goal); }, (error) => resolve(String(error)));
  });
  const offered = new ROSLIB.Service({ ros, name: "/page", serviceType: "std_srvs/srv/Trigger" });
  await offered.advertise((request, response) => { response.success = true; response.message = "hello"; return true; });
  const itself = await new Promise((resolve, reject) => {
    const other = new ROSLIB.Ros({ url: `ws://${location.host}/rosbridge` });
    other.on("connection", () => new ROSLIB.Service({ ros: other, name: "/page", serviceType: "std_srvs/srv/Trigger" })
      .callService({}, resolve, reject));
  });
  ros.close();
  return JSON.stringify({ state, dof, wrong, topics: topics.topics, feedback, result, itself });
}
