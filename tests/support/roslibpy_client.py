"""What a client made with roslibpy sees of a running service, printed as JSON.

A process of its own, for roslibpy's event loop can be started only once and warns of what pytest forbids.
`python roslibpy_client.py ws://HOST:PORT/rosbridge ROBOT SCENARIO`
"""

from __future__ import annotations

import json
import queue
import sys
import threading
from typing import Any

import roslibpy
import roslibpy.ros2

WAIT_S = 30.0


def _count(ros: roslibpy.Ros, robot: str) -> dict[str, Any]:
    """Joint states, without and with throttling; a message of roslibpy's own header type."""
    found: dict[str, Any] = {}
    for name, throttle in (("all", 0), ("throttled", 100)):
        got: queue.Queue[Any] = queue.Queue()
        topic = roslibpy.Topic(
            ros, f"/{robot}/joint_states", "sensor_msgs/JointState", throttle_rate=throttle
        )
        topic.subscribe(got.put)
        found[name] = [got.get(timeout=WAIT_S) for _ in range(20)]
        topic.unsubscribe()
    for name, type_ in (
        ("tcp_pose", "geometry_msgs/PoseStamped"),
        ("wrench", "geometry_msgs/WrenchStamped"),
        ("status", "std_msgs/String"),
        ("robot_description", "std_msgs/String"),
    ):
        found[name] = _first(ros, f"/{robot}/{name}", type_)
    found["tf"] = _first(ros, "/tf", "tf2_msgs/TFMessage")
    found["tf_static"] = _first(ros, "/tf_static", "tf2_msgs/TFMessage")
    return found


def _first(ros: roslibpy.Ros, name: str, type_: str) -> Any:
    got: queue.Queue[Any] = queue.Queue()
    topic = roslibpy.Topic(ros, name, type_)
    topic.subscribe(got.put)
    message = got.get(timeout=WAIT_S)
    topic.unsubscribe()
    return message


def _chat(ros: roslibpy.Ros, robot: str) -> dict[str, Any]:
    """Two clients, a topic and a service between them."""
    other = roslibpy.Ros(sys.argv[1])
    other.run()
    got: queue.Queue[Any] = queue.Queue()
    roslibpy.Topic(other, "/chat", "std_msgs/Header").subscribe(got.put)
    talker = roslibpy.Topic(ros, "/chat", "std_msgs/Header")
    stamp = {"secs": 7, "nsecs": 8}
    while got.empty():  # the other's subscription may still be on its way
        talker.publish(roslibpy.Message(dict(roslibpy.ros2.Header(stamp=stamp, frame_id="base"))))
        threading.Event().wait(0.01)
    heard = got.get()
    service = roslibpy.Service(ros, "/is_even", "std_srvs/SetBool")

    def answer(request: Any, response: Any) -> bool:
        response["success"] = not request["data"]
        response["message"] = "odd"
        return True

    service.advertise(answer)
    while "/is_even" not in other.get_services():
        threading.Event().wait(0.01)
    result: queue.Queue[Any] = queue.Queue()
    call = roslibpy.Service(other, "/is_even", "std_srvs/SetBool")
    call.call(roslibpy.ServiceRequest({"data": True}), lambda answer: result.put(dict(answer)), result.put)
    return {"heard": heard, "answer": result.get(timeout=WAIT_S)}


def _ask(ros: roslibpy.Ros, robot: str) -> dict[str, Any]:
    """Services of the robot, rosapi, and what is wrong."""
    found: dict[str, Any] = {}
    for method, arguments in (
        ("RobotConfig/getDof", {}),
        ("RobotAlgorithm/forwardKinematics", {"q": [0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0]}),
        ("RobotAlgorithm/nothing", {}),
    ):
        service = roslibpy.Service(ros, f"/{robot}/{method}", "aubo_interfaces/Any")
        result: queue.Queue[Any] = queue.Queue()
        service.call(
            roslibpy.ServiceRequest(arguments),
            lambda answer, result=result: result.put(dict(answer)),
            result.put,
        )
        found[method] = result.get(timeout=WAIT_S)
    found["topics"] = ros.get_topics()
    found["type"] = ros.get_topic_type(f"/{robot}/joint_states")
    found["services"] = ros.get_services()
    actions: queue.Queue[Any] = queue.Queue()
    ros.get_action_servers(lambda answer: actions.put(dict(answer)))
    found["actions"] = actions.get(timeout=WAIT_S)
    found["nodes"] = ros.get_nodes()
    found["message"] = ros.get_message_details("sensor_msgs/JointState")
    found["request"] = ros.get_service_request_details("std_srvs/SetBool")
    return found


def _serve(ros: roslibpy.Ros, robot: str) -> dict[str, Any]:
    """A servo session as an action: points on joint_cmd, feedback, cancel; and a goal that is refused."""
    client = roslibpy.ActionClient(ros, f"/{robot}/servo_mode", "aubo_interfaces/action/ServoMode")
    ends: queue.Queue[Any] = queue.Queue()
    feedback: queue.Queue[Any] = queue.Queue()
    goal_id = client.send_goal(
        roslibpy.Goal({"mode": 1, "watchdog_timeout": 20.0}),
        ends.put,
        lambda values: feedback.put(dict(values)),
        ends.put,
    )
    first = feedback.get(timeout=WAIT_S)
    commands = roslibpy.Topic(ros, f"/{robot}/joint_cmd", "std_msgs/String")
    for number in range(1, 21):
        point = {
            "type": "servo_point",
            "session_id": 1,
            "point_id": number,
            "point_type": "joint",
            "position": [0.002 * number, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0],
            "time": 0.02,
        }
        commands.publish(roslibpy.Message({"data": json.dumps(point)}))
        threading.Event().wait(0.02)
    last = first
    while last["points_received"] < 20:
        last = feedback.get(timeout=WAIT_S)
    refused: queue.Queue[Any] = queue.Queue()
    client.send_goal(roslibpy.Goal({"mode": 2}), refused.put, refused.put, refused.put)
    no = refused.get(timeout=WAIT_S)
    client.cancel_goal(goal_id)
    end = ends.get(timeout=WAIT_S)
    return {
        "last": last,
        "refused": {"status": no["status"].value, "values": no["values"]},
        "end": {"status": end["status"].value, "values": end["values"]},
    }


def _follow(ros: roslibpy.Ros, robot: str) -> dict[str, Any]:
    """A trajectory that is followed, one that is cancelled, and one for other joints."""
    name, type_ = f"/{robot}/follow_joint_trajectory", "control_msgs/action/FollowJointTrajectory"
    client = roslibpy.ActionClient(ros, name, type_)
    home, names = [0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0], [f"joint{number}" for number in range(1, 8)]

    def goal(turn: float, seconds: int, joints: list[str]) -> roslibpy.Goal:
        point = {"positions": [turn, *home[1:]], "time_from_start": {"sec": seconds, "nanosec": 0}}
        return roslibpy.Goal({"trajectory": {"joint_names": joints, "points": [point]}})

    found: dict[str, Any] = {}
    for what, wanted in (
        ("followed", goal(0.2, 2, names)),
        ("cancelled", goal(0.8, 8, names)),
        ("strange", goal(0.0, 2, names[:6])),
    ):
        ends: queue.Queue[Any] = queue.Queue()
        feedback: queue.Queue[Any] = queue.Queue()
        goal_id = client.send_goal(
            wanted, ends.put, lambda values, to=feedback: to.put(dict(values)), ends.put
        )
        if what == "cancelled":
            for _ in range(5):
                feedback.get(timeout=WAIT_S)
            client.cancel_goal(goal_id)
        end = ends.get(timeout=WAIT_S)
        told = [feedback.get() for _ in range(feedback.qsize())]
        found[what] = {"status": end["status"].value, "values": end["values"], "feedback": told}
    return found


SCENARIOS = {"count": _count, "chat": _chat, "ask": _ask, "serve": _serve, "follow": _follow}

if __name__ == "__main__":
    client = roslibpy.Ros(sys.argv[1])
    client.run()
    print(json.dumps(SCENARIOS[sys.argv[3]](client, sys.argv[2]), default=dict), flush=True)
    client.terminate()
