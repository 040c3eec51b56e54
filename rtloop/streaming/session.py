"""A streaming session: who may, what is streamed, and what ends it.

A long module, because a session is one state; what has a state of its own (blocks, sources, monitor) has a
module of its own.
"""

from __future__ import annotations

import os
import select
from dataclasses import replace

import numpy as np

from cobot.config import StreamingSection
from cobot.ipc.layout import Ack, Interpolation, Intervention, ServoMode, Stream
from cobot.ipc.shm import RobotMemory
from cobot.robot.model import RobotModel
from cobot.types import Array, CartesianLimits, JointLimits, LoopMode
from rtloop.backends import Backend, Impedance, ImpedanceControlled, Measured
from rtloop.inboxes.point_queue import PointQueue
from rtloop.inboxes.stream import StreamInbox
from rtloop.safety.limiter import Safety
from rtloop.sources.cartesian import CartesianSource
from rtloop.sources.joint import JointSource, Source, TorqueSource
from rtloop.sources.servo_base import ServoSource
from rtloop.sources.servo_force import ForceServo
from rtloop.sources.servo_modes import make_servo
from rtloop.sources.target_checks import DEFAULT_INTERVAL_S
from rtloop.streaming.collision_monitor import CollisionMonitor
from rtloop.streaming.session_checks import session_refusal

MODES = {
    Stream.JOINT_IMPEDANCE: LoopMode.JOINT_IMPEDANCE,
    Stream.CARTESIAN: LoopMode.CARTESIAN,
    Stream.JOINT_TORQUE: LoopMode.JOINT_TORQUE,
}
AXES = ("x", "y", "z", "rx", "ry", "rz")
PERIODS_TO_TIMEOUT = 3
"""A client that said it would send less often is not silent yet."""
ALIVE_CYCLES = 50
"""So often it is asked whether the client's process still lives."""
CATCH_UP_RAD_S = 0.05
"""A pose that was limited to the TCP's velocity has to be followed at that velocity, and little more."""
FINISH_S = 1.0
"""So long a servo session that is to end goes on with the points that it has."""
TORQUE_FREQUENCY_RAD_S = 12.0
"""Of the springs that follow a torque-controlled reference: well below what the estimate of external torques
can follow, or the two would swing against each other."""


class Streaming:
    """Follows one client's targets. Real-time safe, but for `open`, which takes place at rest.

    Attributes:
        session: number of the session that moves the arm, 0 for none.
        mode: of rtloop, for this session.
        holding: whether the arm shall come to rest and wait for the next target.
        problem: why the session cannot go on; "" while it can.
        not_finite: what the client has streamed that is no number; "" while it has not.
    """

    def __init__(
        self,
        section: StreamingSection,
        model: RobotModel,
        memory: RobotMemory,
        backend: Backend,
        safety: Safety,
        period_s: float,
    ) -> None:
        self.box = StreamInbox(memory)
        self._points = PointQueue(memory)
        self._servo: ServoSource | None = None
        self._watchdog_cycles = self._finishing_cycles = self._dropped = 0
        self._model = model
        self._limits = model.limits
        self._backend = backend
        self._safety = safety
        self._period_s = period_s
        self._timeout_cycles = round(section.command_timeout_s / period_s)
        self._stream_limits = _stream_limits(section, model.limits)
        self._tcp_limits = CartesianLimits(
            section.linear_velocity,
            section.linear_acceleration,
            section.linear_jerk,
            section.angular_velocity,
            section.angular_acceleration,
            section.angular_jerk,
        )
        self._collision_monitor = CollisionMonitor(model, section, self._stream_limits)
        self._largest_contact = np.zeros(model.dof + 6)
        self._life: select.poll | None = None
        self._life_fd = -1
        self._source: Source | None = None
        self.session = 0
        self.mode = LoopMode.HOLD
        self.holding = self._blocked = self._slowed = self._live = self._target_waits = False
        self.problem = self.not_finite = ""
        self._decimation = 1
        self._cycle = self._silent_cycles = self._untaken_cycles = 0
        self._cancel_seen = self._starved = 0
        self.setpoint_seen = 0
        self.move_seen = 0
        self.chunk_seen = 0

    @property
    def reference(self) -> Array:
        assert self._source is not None
        return self._source.reference

    @property
    def move_running(self) -> bool:
        """Whether a `move_to_pose` is under way."""
        return isinstance(self._source, CartesianSource) and self._source.move_running

    @property
    def from_service(self) -> bool:
        """Whether it is a servo session, whose points wait here: they come from the service, and nobody else
        can end it.
        """
        return self.session != 0 and self._servo is not None

    @property
    def point_counts(self) -> tuple[int, int, int, int, int]:
        """Of the last servo session: points read, taken, dropped, still ahead; and underruns."""
        servo, queue = self._servo, self._points
        if servo is None:
            return (0, 0, 0, 0, 0)
        ahead = queue.waiting + servo.buffered if self.session else 0
        return queue.seen, servo.taken, servo.dropped + queue.lost, ahead, servo.underruns

    @property
    def torn_reads(self) -> int:
        return self.box.torn_reads + self._points.torn_reads

    def open(self, command: Array, mode: LoopMode, stops: int) -> str:
        """Answer the client that asks: begin the session in which it streams.

        Args:
            command: where the arm is commanded to be, at rest, shape (3, dof).
            mode: of rtloop; only HOLD permits a session.
            stops: that were requested so far.

        Returns:
            "" or why not.
        """
        wish = self.box.session.data
        refusal = ""
        if mode is not LoopMode.HOLD:
            refusal = f"the arm is in mode {mode.name}"
        elif int(wish["stops"]) != stops:
            refusal = "a stop was requested meanwhile"
        refusal = refusal or session_refusal(wish, self._backend) or self._watch(int(wish["pid"]))
        if not refusal:
            self._begin(wish, command)
        self.box.answer(Ack.REJECTED if refusal else Ack.ACCEPTED, refusal)
        return refusal

    def close(self) -> None:
        """The arm is at rest and position-controlled again."""
        self.session = 0
        self._source = None
        self._life = None
        os.close(self._life_fd)
        self._safety.use(self._limits)
        if isinstance(self._backend, ImpedanceControlled):
            self._backend.set_impedance(None)

    def advance(self, measured: Measured, robot_time_s: float) -> None:
        """One period on; then `problem`, `holding` and `reference` say what to do."""
        source = self._source
        assert source is not None
        self._cycle += 1
        self._silent_cycles += 1
        if not self.box.wants(self.session):
            self.problem = "the client has ended the session"
        elif self._cycle % ALIVE_CYCLES == 0 and self._life is not None and self._life.poll(0):
            self.problem = "the streaming client has died"
        if self._servo is not None:
            self._serve(self._servo, measured)
            return
        self._untaken_cycles += 1
        self._read_setpoint()
        if self.box.chunk.changed():
            self._take_chunk(self.box.chunk.data, robot_time_s)
        patience_cycles = max(self._timeout_cycles, PERIODS_TO_TIMEOUT * self._decimation)
        if self._live and self._silent_cycles > patience_cycles:
            self._live = False
            self._hold(Intervention.COMMAND_TIMEOUT)
        if not self.holding:
            source.advance(measured)
        if isinstance(source, JointSource):
            self._watch_chunks(source)
        self._watch_contact(measured)
        self._watch_surroundings()

    def _serve(self, servo: ServoSource, measured: Measured) -> None:
        """Follow the points of a servo session: what would hold a stream ends it."""
        if self._points.poll():
            self._silent_cycles = 0
        elif self._silent_cycles > self._watchdog_cycles and not (self.problem or self.box.finishes):
            self._safety.count(Intervention.COMMAND_TIMEOUT)
            self.problem = f"servo watchdog: no point for {self._watchdog_cycles * self._period_s:g} s"
        setpoint = self.box.setpoint
        news = setpoint.changed() and int(setpoint.data["session"]) == self.session
        if news and isinstance(servo, ForceServo):
            servo.press(setpoint.data["wrench"])
        if self.box.finishes:
            self._finishing_cycles += 1
            done = not (self._points.waiting or servo.buffered or servo.reference[1:].any())
            if done or self._finishing_cycles * self._period_s > FINISH_S:
                self.problem = self.problem or "the client has ended the session"
        if servo.fetch(self._points) is Intervention.NOT_FINITE:
            self._safety.count(Intervention.NOT_FINITE)
            self.not_finite = servo.refusal
        if servo.dropped != self._dropped:
            self._dropped = servo.dropped
            self._safety.count(Intervention.JUMP)
        servo.advance(measured)
        self._watch_contact(measured)
        self._watch_surroundings()
        if self.holding:
            self.problem = self.problem or "the points lead the arm into itself or its surroundings"

    def follow(self) -> None:
        """To be called when the safety layer has let this cycle's command through."""
        assert self._source is not None
        self._source.follow(self._safety.command)

    def _watch(self, pid: int) -> str:
        """Have the kernel tell when the client's process ends; "" or why it cannot."""
        try:
            self._life_fd = os.pidfd_open(pid)
        except (OSError, OverflowError) as exc:
            return f"the streaming client, process {pid}, cannot be watched: {exc}"
        self._life = select.poll()
        self._life.register(self._life_fd, select.POLLIN)
        return ""

    def _begin(self, wish: np.ndarray, command: Array) -> None:
        kind, stream = Interpolation(int(wish["interpolation"])), Stream(int(wish["stream"]))
        self._decimation = int(wish["decimation"])
        command_s = self._decimation * self._period_s
        # Poses have limits of their own, torques have none but the robot's.
        joints = stream is Stream.JOINT_IMPEDANCE or int(wish["servo_mode"]) != ServoMode.NONE
        limits = self._stream_limits if joints else self._limits
        impedance = Impedance(False, wish["stiffness"].copy(), wish["damping_ratio"].copy())
        servo = ServoMode(int(wish["servo_mode"]))
        points = make_servo(servo, self._stream_limits, self._limits.max_velocity, self._period_s)
        self._servo = points
        match stream:
            case Stream.JOINT_IMPEDANCE if points is not None:
                self._source = points
            case Stream.CARTESIAN if points is not None:
                self._servo = self._source = ForceServo(
                    points, self._model, limits, self._tcp_limits, self._period_s, wish
                )
                impedance = Impedance(
                    True, wish["cartesian_stiffness"].copy(), wish["cartesian_damping_ratio"].copy()
                )
            case Stream.JOINT_IMPEDANCE:
                self._source = JointSource(kind, limits, self._limits.max_velocity, self._period_s, command_s)
            case Stream.CARTESIAN:
                self._source = CartesianSource(
                    kind, self._model, limits, self._tcp_limits, self._period_s, command_s, wish
                )
                impedance = Impedance(
                    True, wish["cartesian_stiffness"].copy(), wish["cartesian_damping_ratio"].copy()
                )
            case Stream.JOINT_TORQUE:
                self._source = TorqueSource(self._model, limits, self._period_s)
                stiffness = self._model.mass_matrix(command[0]).diagonal() * TORQUE_FREQUENCY_RAD_S**2
                impedance = Impedance(False, stiffness, np.ones(self._limits.dof))
        if isinstance(self._backend, ImpedanceControlled):
            self._backend.set_impedance(impedance)
        self._largest_contact[:] = *wish["max_contact_torque"], *wish["max_contact_wrench"]
        self._collision_monitor.begin(touching=bool(wish["force_axes"].any()))
        self._safety.use(limits, catch_up=np.inf if joints else CATCH_UP_RAD_S)
        self._source.begin(command)
        self.mode = MODES[stream]
        self.session = int(wish["number"])
        self.setpoint_seen = self.move_seen = self._cancel_seen = self.chunk_seen = 0
        self.holding = self._blocked = False
        self.problem = self.not_finite = ""
        self._cycle = 0
        self._silent_cycles = 0
        self._untaken_cycles = self._decimation  # the first target is taken at once
        self._live = self._slowed = self._target_waits = False
        self._starved = self._dropped = self._finishing_cycles = 0
        self._points.begin(self.session)
        if self._servo is not None:
            self._watchdog_cycles = round(float(wish["watchdog_s"]) / self._period_s)

    def _read_setpoint(self) -> None:
        """Whatever is new in what the client has written: moves at once, a target when it is time for one."""
        box, source = self.box.setpoint, self._source
        if box.changed():
            self._target_waits = True
            if isinstance(source, CartesianSource) and int(box.data["session"]) == self.session:
                self._take_move(source, box.data)
        if self._target_waits and box.readable and self._untaken_cycles >= self._decimation:
            self._target_waits = False
            self._take(box.data)

    def _take(self, setpoint: np.ndarray) -> None:
        source, number = self._source, int(setpoint["number"])
        assert source is not None
        if int(setpoint["session"]) != self.session or number == self.setpoint_seen:
            return
        self._untaken_cycles = 0
        interval_s = max(DEFAULT_INTERVAL_S, self._decimation * self._period_s)
        if self.setpoint_seen:
            interval_s = self._silent_cycles * self._period_s
        self.setpoint_seen = number
        if self.move_running:
            return
        self._silent_cycles = 0
        self._live = True
        self._go_on()
        self._judge(source.take(setpoint, interval_s))

    def _take_chunk(self, chunk: np.ndarray, robot_time_s: float) -> None:
        source = self._source
        if int(chunk["session"]) != self.session or not isinstance(source, JointSource):
            return
        self.chunk_seen = int(chunk["number"])
        self._go_on()
        late = source.late
        flaw = source.take_chunk(chunk, robot_time_s)
        if flaw is None or flaw is Intervention.NOT_FINITE:
            self._live = False
            self._judge(flaw)
        if flaw is Intervention.JUMP or flaw is Intervention.LATE or source.late != late:
            self._safety.count(flaw or Intervention.LATE)  # and the chunk before goes on

    def _watch_chunks(self, source: JointSource) -> None:
        if source.starved != self._starved:
            self._starved = source.starved
            self._safety.count(Intervention.COMMAND_TIMEOUT)

    def _take_move(self, source: CartesianSource, setpoint: np.ndarray) -> None:
        move, cancel = int(setpoint["move"]), int(setpoint["cancel"])
        if move != self.move_seen:
            self.move_seen = move
            self._live = False
            self._go_on()
            self._judge(source.start_move(setpoint["move_pose"], float(setpoint["move_duration_s"])))
        if cancel != self._cancel_seen:
            self._cancel_seen = cancel
            if cancel == self.move_seen and source.move_running:
                source.cancel_move()
                self.holding = True

    def _go_on(self) -> None:
        """A target ends the waiting, from wherever the arm is by now."""
        if self.holding:
            assert self._source is not None
            self._source.begin(self._safety.command)

    def _judge(self, flaw: Intervention | None) -> None:
        """Follow the target that was just taken, or not."""
        source = self._source
        assert source is not None
        if flaw is Intervention.NOT_FINITE:
            self._safety.count(flaw)
            self.not_finite = source.refusal
        elif flaw is not None:
            self._hold(flaw)
        elif self._blocked:
            self._blocked = not self._collision_monitor.leads_away(self._safety.position, source.heading)
            self.holding = self._blocked
        else:
            self.holding = False

    def _hold(self, why: Intervention) -> None:
        if not self.holding:
            self._safety.count(why)
        self.holding = True

    def _watch_contact(self, measured: Measured) -> None:
        excess = np.abs(measured.external) - self._largest_contact
        index = int(excess.argmax())
        if excess[index] > 0.0:
            self._safety.count(Intervention.CONTACT)
            joints = self._limits.dof
            where, unit = (
                (f"on {self._limits.names[index]}", "N·m")
                if index < joints
                else (f"along {AXES[index - joints]} at the TCP", "N or N·m")
            )
            self.problem = (
                f"contact: {measured.external[index]:.1f} {unit} {where}, "
                f"allowed are {self._largest_contact[index]:g}"
            )

    def _watch_surroundings(self) -> None:
        monitor, safety = self._collision_monitor, self._safety
        monitor.look(safety.command)
        if monitor.share < 1.0 and not self._slowed:
            safety.count(Intervention.PROXIMITY)
        self._slowed = monitor.share < 1.0
        safety.slow_down(monitor.share)
        if monitor.blocked and not self.holding:
            self._blocked = True
            self._hold(Intervention.COLLISION)


def _stream_limits(section: StreamingSection, limits: JointLimits) -> JointLimits:
    return replace(
        limits,
        max_velocity=np.minimum(limits.max_velocity, section.joint_velocity),
        max_acceleration=np.minimum(limits.max_acceleration, section.joint_acceleration),
    )
