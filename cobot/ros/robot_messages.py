"""ROS messages of a robot for all transports, created from the state that rtloop publishes."""

from __future__ import annotations

import json

import mujoco
import numpy as np

from cobot.client.states import Values, cartesian_state
from cobot.clock import SYSTEM, Clock, WallTime
from cobot.ipc.layout import text
from cobot.robot.model import RobotModel
from cobot.robot.quaternion import conjugate, product, rotated
from cobot.ros.fingers import FINGER_JOINTS, FingerState
from cobot.ros.messages import Message, ros_time
from cobot.ros.urdf import WORLD, link_name, urdf
from cobot.types import Array, LoopMode

JOINT_STATES = "sensor_msgs/msg/JointState"
POSE = "geometry_msgs/msg/PoseStamped"
WRENCH = "geometry_msgs/msg/WrenchStamped"
STRING = "std_msgs/msg/String"
TRANSFORMS = "tf2_msgs/msg/TFMessage"
MEASURED = ("position", "velocity", "effort")
"""The arrays of a JointState message, in order."""


class RobotMessages:
    """Creates messages of one robot. `state` is a record of `cobot.ipc.state_fields.state_dtype`; all values
    are in SI units.

    The names of frames are those of the model's bodies. The TCP has the name of its site, and the model's
    world is called `world`.

    Args:
        base: name of the body whose frame is used for all poses.
        tcp: name of the site at the TCP.
        prefix: prefix of frame names, such as "iiwa/", if several robots share one tree.
        clock: clock of the times in the state.
    """

    def __init__(
        self, model: RobotModel, base: str, tcp: str, prefix: str = "", clock: Clock = SYSTEM
    ) -> None:
        self._clock, self._wall_time = clock, WallTime(clock)
        self._model = model.mj
        self._data = mujoco.MjData(model.mj)
        self._limits = model.limits
        self._names = list(model.limits.names)
        self._prefix = prefix
        self._base = prefix + base
        self._tcp = prefix + tcp
        self._tcp_site = model.tcp_site
        self._moving = [body for body in range(1, model.mj.nbody) if model.mj.body_jntnum[body]]
        self._fixed = [body for body in range(1, model.mj.nbody) if not model.mj.body_jntnum[body]]

    def joint_state(self, state: np.ndarray, fingers: FingerState | None = None) -> Message:
        """sensor_msgs/msg/JointState with measured values in rad, rad/s and N·m. If the state of the fingers
        is known, the finger joints are listed last.
        """
        rows = {} if fingers is None else fingers.rows
        measured = {name: state[name].tolist() + rows.get(name, []) for name in MEASURED}
        names = self._names if fingers is None else [*self._names, *FINGER_JOINTS]
        return {"header": self._header(state, self._base), "name": names, **measured}

    def pose(self, state: np.ndarray) -> Message:
        """geometry_msgs/msg/PoseStamped with the measured pose of the TCP in the base frame."""
        x, y, z, *turn = state["tcp"].tolist()
        return {
            "header": self._header(state, self._base),
            "pose": {"position": _xyz([x, y, z]), "orientation": _orientation(turn)},
        }

    def wrench(self, state: np.ndarray) -> Message:
        """geometry_msgs/msg/WrenchStamped with the wrench that the surroundings exert at the TCP, in the
        TCP's frame.
        """
        wrench = cartesian_state(state).ext_wrench_in_tcp
        return {
            "header": self._header(state, self._tcp),
            "wrench": {"force": _xyz(wrench[:3]), "torque": _xyz(wrench[3:])},
        }

    def status(self, state: np.ndarray) -> Message:
        """std_msgs/msg/String with a JSON object that contains mode, settled, reason, session, motion_id and
        overruns.
        """
        content = {name: int(state[name]) for name in ("session", "motion_id", "overruns")}
        mode = LoopMode(int(state["mode"])).name
        return {
            "data": json.dumps(
                {"mode": mode, "settled": bool(state["settled"]), "reason": text(state["reason"]), **content}
            )
        }

    def transforms(self, state: np.ndarray) -> Message:
        """tf2_msgs/msg/TFMessage for /tf, with the pose of each moving link in its parent's frame."""
        stamp = self._header(state, "")["stamp"]
        self._place(state["position"])
        return {"transforms": [self._transform(body, stamp) for body in self._moving]}

    def static_transforms(self) -> Message:
        """tf2_msgs/msg/TFMessage for /tf_static, with the links that no joint moves, and the TCP."""
        self._place(np.zeros(len(self._names)))
        stamp = ros_time(self._clock.wall_ns())
        made = [self._transform(body, stamp) for body in self._fixed]
        holder = self._name(int(self._model.site_bodyid[self._tcp_site]))
        if holder != self._tcp:  # in a URDF, the TCP is a link
            position = self._model.site_pos[self._tcp_site].tolist()
            turn = self._model.site_quat[self._tcp_site].tolist()
            made.append(_transform(holder, self._tcp, position, turn, stamp))
        return {"transforms": made}

    def description(self) -> Message:
        """std_msgs/msg/String for /robot_description, with a URDF."""
        return {"data": urdf(self._model, self._limits, self._tcp_site)}

    def measured_at(self, state: np.ndarray) -> int:
        """The time of day at which a state was measured, in ns since 1970."""
        return self._wall_time.at(int(state["measured_monotonic_ns"]))

    def _place(self, joints: Array) -> None:
        self._data.qpos[:] = joints
        mujoco.mj_kinematics(self._model, self._data)

    def _transform(self, body: int, stamp: Message) -> Message:
        parent = int(self._model.body_parentid[body])
        back = conjugate(self._data.xquat[parent].tolist())
        position = rotated(back, (self._data.xpos[body] - self._data.xpos[parent]).tolist())
        turn = product(back, self._data.xquat[body].tolist())
        return _transform(self._name(parent), self._name(body), list(position), list(turn), stamp)

    def _header(self, state: np.ndarray, frame: str) -> Message:
        return {"stamp": ros_time(self.measured_at(state)), "frame_id": frame}

    def _name(self, body: int) -> str:
        return WORLD if body == 0 else self._prefix + link_name(self._model, body)


def _xyz(values: Values) -> Message:
    x, y, z = values
    return {"x": x, "y": y, "z": z}


def _orientation(turn: Values) -> Message:
    w, x, y, z = turn
    return {"x": x, "y": y, "z": z, "w": w}


def _transform(parent: str, child: str, position: Values, turn: Values, stamp: Message) -> Message:
    return {
        "header": {"stamp": stamp, "frame_id": parent},
        "child_frame_id": child,
        "transform": {"translation": _xyz(position), "rotation": _orientation(turn)},
    }
