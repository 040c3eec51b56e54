"""A streaming session: its admission, its streams, and the reasons for its end."""

import numpy as np

from cobot.ipc.layout import Interpolation, Intervention, ServoMode, Stream
from cobot.reasons import Reason, ReasonCode
from cobot.robot.limits import streamed
from cobot.types import CartesianLimits, LoopMode
from rtloop.backends import BackendError, Impedance, ImpedanceControlled
from rtloop.results import ACCEPTED, Rejected
from rtloop.sources.cartesian import CartesianSource
from rtloop.sources.joint import JointSource
from rtloop.sources.servo_force import ForceServo
from rtloop.sources.servo_modes import make_servo
from rtloop.sources.torque import TorqueSource
from rtloop.streaming.overlay import overlay_of
from rtloop.streaming.session_checks import check_session
from rtloop.streaming.session_limits import MIN_SHARE, SessionLimits

from libc.string cimport memset

from cobot.arrays cimport doubles
from rtloop.sources.source cimport Source
from rtloop.streaming.feed cimport CLIENT_DIED, CLIENT_ENDED, CONTACT, OBSTACLE, SERVO_WATCHDOG

MODES = {
    Stream.JOINT_IMPEDANCE: LoopMode.JOINT_IMPEDANCE,
    Stream.CARTESIAN: LoopMode.CARTESIAN,
    Stream.JOINT_TORQUE: LoopMode.JOINT_TORQUE,
    Stream.GUIDED: LoopMode.JOINT_IMPEDANCE,
}
cdef int COUNT_CONTACT = Intervention.CONTACT
# Number of cycles between two checks whether the client's process still exists.
cdef long long ALIVE_CYCLES = 50
# If a pose is limited to the TCP velocity, the joints must follow it only slightly faster.
CATCH_UP_RAD_S = 0.05
# The springs that follow a torque-controlled reference are much softer than the estimate of external torques
# can follow; otherwise both would oscillate against each other.
TORQUE_FREQUENCY_RAD_S = 12.0


cdef class Session:
    """A session, which follows one client's targets. Methods with the prefix `c_` are real-time safe; the
    others are called at rest.

    Attributes:
        box: the blocks of the client.
        session: number of the session that moves the arm, 0 for none.
        mode: rtloop's mode for this session.
        t1_share: permitted share of the joints' maximum speed in T1; None if the session was not begun in T1.
        guided: whether the device itself lets a person guide the arm. In that case there are no targets.
        overlay: adds forces or torques to positions, a `rtloop.streaming.overlay.Overlay`; None if positions
            and an impedance suffice.
    """

    def __init__(self, settings, model, memory, backend, Safety safety):
        cdef double period_s = settings.rt.period_s
        section = settings.streaming
        self._backend_name = settings.robot.backend.type
        self.overlay = None
        limits = model.limits
        self._exerted = np.zeros(max(limits.dof, 6))
        self._c_exerted = doubles(self._exerted, len(self._exerted))
        self.box = StreamInbox(memory)
        self._queue = PointQueue(memory)
        self._model = model
        self._limits = limits
        self._backend = backend
        self._safety = safety
        self._period_s = period_s
        self._timeout_cycles = round(section.command_timeout_s / period_s)
        tcp = CartesianLimits(
            section.linear_velocity,
            section.linear_acceleration,
            section.linear_jerk,
            section.angular_velocity,
            section.angular_acceleration,
            section.angular_jerk,
        )
        self._session_limits = SessionLimits(streamed(limits, section), limits, tcp)
        self.t1_share = None
        self._client = ClientWatch()
        self._collision_monitor = CollisionMonitor(model, section, period_s)
        self._contact_monitor = ContactMonitor(limits.names)
        self.session = 0
        self.mode = LoopMode.HOLD
        self.has_targets = self.has_points = self.guided = self._released = False

    @property
    def move_running(self):
        """Whether a `move_to_pose` is running."""
        return self.targets is not None and self.targets.c_move_running()

    def explain_end(self):
        """Return the reason why the feed ends the session. Call this only if the feed has a `problem`."""
        cdef int problem = self.feed.problem
        if problem == CONTACT:
            return self._contact_monitor.reason()
        if problem == SERVO_WATCHDOG:
            limit_s = self.points.watchdog_s
            words = f"servo watchdog: no point for {limit_s:g} s"
            return Reason(words, ReasonCode.NO_POINTS, limit=limit_s, unit="s")
        if problem == OBSTACLE:
            pairs = self._collision_monitor.blocking()
            named = ", ".join(" and ".join(pair) for pair in pairs)
            words = f"the points lead the arm into itself or its surroundings: {named}"
            return Reason(words, ReasonCode.OBSTACLE, of=tuple(dict.fromkeys(sum(pairs, ()))))
        return {
            CLIENT_ENDED: Reason("the client has ended the session", ReasonCode.CLIENT_ENDED),
            CLIENT_DIED: Reason("the streaming client has died", ReasonCode.CLIENT_DIED),
        }[problem]

    def explain_not_finite(self):
        """Name the streamed value that is not finite. Call this only if the feed has found one."""
        return (self.points.points if self.has_points else self.feed.source).explain()

    def watch(self, CollisionMonitor monitor):
        """Use another collision monitor from the next session on."""
        self._collision_monitor = monitor

    def open(self, command, mode, stops, t1_share=None):
        """Begin the session that a client has requested.

        Args:
            command: commanded position of the arm, at rest, shape (3, dof).
            mode: rtloop's mode; only HOLD permits a session.
            stops: number of stops requested so far.
            t1_share: see `Session`.

        Returns:
            `ACCEPTED`, or `Rejected` with the reason.
        """
        self.t1_share = t1_share
        request = self.box.session.data
        if mode is not LoopMode.HOLD:
            return Rejected(f"the arm is in mode {mode.name}")
        if int(request["stops"]) != stops:
            return Rejected("a stop has been requested in the meantime")
        if t1_share is not None and t1_share < MIN_SHARE:
            return Rejected(
                f"the robot is in T1 and permits {t1_share:g} of its speed, "
                f"a stream needs {MIN_SHARE:g} or more"
            )
        result = check_session(request, self._backend, self._backend_name)
        if result == ACCEPTED:
            result = self._client.begin(int(request["pid"]))
        if result == ACCEPTED:
            result = self._try_to_begin(request, command)
        return result

    def close(self):
        """End the session, and switch the arm, which is at rest, to position control.

        Returns:
            `ACCEPTED`, or `Rejected` if the robot refuses; the session has ended in both cases.
        """
        held = self.end_guiding()
        if self.guided and held == ACCEPTED:
            held = self._guide(self._backend.follow_commands)
        self.session, self.guided = 0, False
        self._client.end()
        self._safety.use(self._limits)
        self._safety.stay_within(None)
        if self.overlay is not None:
            self.overlay.end()
            self.overlay = None
        try:
            if isinstance(self._backend, ImpedanceControlled):
                self._backend.set_impedance(None)
        except BackendError as exc:
            words = f"the robot cannot be held at its position: {exc}"
            return Rejected(Reason(words, ReasonCode.HOLD_REFUSED))
        return held

    def end_guiding(self):
        """If a person is guiding the arm, make the device hold it again. Returns `Rejected` if the device
        refuses.
        """
        released, self._released = self._released, False
        return self._guide(self._backend.end_guiding) if released else ACCEPTED

    def _guide(self, call):
        try:
            call()
        except BackendError as exc:
            words = f"the robot cannot be held at its position: {exc}"
            return Rejected(Reason(words, ReasonCode.HOLD_REFUSED))
        return ACCEPTED

    def _try_to_begin(self, request, command):
        """Begin the session, unless the robot rejects its impedance."""
        try:
            self._begin(request, command)
        except BackendError as exc:
            self._client.end()
            return Rejected(f"the robot cannot be made compliant: {exc}")
        return ACCEPTED

    def _begin(self, request, command):
        stream = Stream(int(request["stream"]))
        # Poses have separate limits. For torques, only the robot's limits apply.
        guided = stream is Stream.GUIDED
        joints = stream is Stream.JOINT_IMPEDANCE or guided or int(request["servo_mode"]) != ServoMode.NONE
        within = self._session_limits
        if self.t1_share is not None:
            within = within.in_t1(self.t1_share)
            request["force_velocity"][:3] = np.minimum(request["force_velocity"][:3], within.force_m_s)
        limits = self._limits if stream is Stream.CARTESIAN else within.torques
        if joints:
            limits = within.joints
        mode = ServoMode(int(request["servo_mode"]))
        points = make_servo(mode, within.joints, self._limits.max_velocity, self._period_s)
        cdef Source source = self._source(stream, request, limits, within.tcp, points)
        if isinstance(self._backend, ImpedanceControlled):
            self._backend.set_impedance(self._impedance(stream, request, command))
        if guided:
            self._backend.begin_guiding()
        self.guided = self._released = guided
        self.overlay = overlay_of(request, self._backend, self._limits, self._period_s)
        self._contact_monitor.begin(request["max_contact_torque"], request["max_contact_wrench"])
        self._collision_monitor.begin(command, touching=bool(request["force_axes"].any()))
        self._safety.use(limits, catch_up=np.inf if joints else CATCH_UP_RAD_S)
        self._safety.stay_within(source.targets)
        source.c_begin(self._safety.c_command)
        shared = self._safety, self._collision_monitor, self.box
        self.has_points = points is not None
        self.has_targets = not self.has_points
        if self.has_points:
            self.points = PointFeed(source, points, *shared, self._queue, self._period_s, request)
            self.feed, self.targets = self.points, None
        else:
            self.targets = TargetFeed(source, *shared, self._period_s, request, self._timeout_cycles)
            self.feed, self.points = self.targets, None
        self.mode = MODES[stream]
        self.session = int(request["number"])
        self._queue.begin(self.session)
        self._cycle = 0

    def _source(self, stream, request, limits, tcp, points):
        kind = Interpolation(int(request["interpolation"]))
        command_s = int(request["decimation"]) * self._period_s
        if points is not None and stream is Stream.JOINT_IMPEDANCE:
            return points
        if points is not None:
            return ForceServo(points, self._model, limits, tcp, self._period_s, request)
        if stream is Stream.JOINT_IMPEDANCE or stream is Stream.GUIDED:
            return JointSource(kind, limits, self._limits.max_velocity, self._period_s, command_s)
        if stream is Stream.CARTESIAN:
            return CartesianSource(kind, self._model, limits, tcp, self._period_s, command_s, request)
        return TorqueSource(self._model, limits, self._period_s)

    def _impedance(self, stream, request, command):
        if stream is Stream.CARTESIAN:
            return Impedance(
                True, request["cartesian_stiffness"].copy(), request["cartesian_damping_ratio"].copy()
            )
        if stream is Stream.JOINT_TORQUE:
            stiffness = self._model.mass_matrix(command[0]).diagonal() * TORQUE_FREQUENCY_RAD_S**2
            return Impedance(False, stiffness, np.ones(self._limits.dof))
        return Impedance(False, request["stiffness"].copy(), request["damping_ratio"].copy())

    def lay_over(self, bint streaming):
        """Apply the client's force or torque, or none while the arm is stopping."""
        memset(self._c_exerted, 0, len(self._exerted) * sizeof(double))
        if streaming:
            self.feed.source.c_exert(self._c_exerted)
        self.overlay.follow(self._exerted[:len(self.overlay.exerted)])

    cdef void c_advance(self, const double* external, double robot_time_s) noexcept nogil:
        """Advance by one period. The result is in the feed.

        Args:
            external: external torques on the joints (dof,), N·m, followed by the external wrench at the TCP
                (6,), N and N·m.
        """
        self._cycle += 1
        if not self.box.c_wants(self.session):
            self.feed.problem = CLIENT_ENDED
        elif self._cycle % ALIVE_CYCLES == 0 and self._client.c_gone():
            self.feed.problem = CLIENT_DIED
        if not self.guided:
            self.feed.c_advance(external, external + self.feed.source.dof, robot_time_s)
        if self._contact_monitor.c_check(external):
            self._safety.c_count(COUNT_CONTACT)
            self.feed.problem = CONTACT
        if not self.guided:
            self.feed.c_watch_surroundings()
        if self.has_points and self.feed.holding:
            self.feed.c_end(OBSTACLE)

    cdef void c_describe(self, StateScalars* state) noexcept nogil:
        """Fill in the state block's fields about the session. Counters stay until the next session begins."""
        state.session = self.session
        state.setpoint_seen = state.move_seen = state.move_running = state.chunk_seen = 0
        state.point_seen = state.points_taken = state.points_dropped = 0
        state.points_buffered = state.underruns = 0
        if self.has_targets:
            state.setpoint_seen = self.targets.setpoint_seen
            state.move_seen = self.targets.move_seen
            state.move_running = self.targets.c_move_running()
            state.chunk_seen = self.targets.chunk_seen
        elif self.has_points:
            state.point_seen = self._queue.seen
            state.points_taken = self.points.points.taken
            state.points_dropped = self.points.points.dropped + self._queue.lost
            if self.session:
                state.points_buffered = self._queue.c_waiting() + self.points.points.c_buffered()
            state.underruns = self.points.points.underruns

    cdef long long c_torn_reads(self) noexcept nogil:
        """Return the number of inconsistent reads of the client's blocks."""
        return self.box.c_torn_reads() + self._queue.c_torn_reads()

    cdef bint c_from_service(self) noexcept nogil:
        """Whether this is a servo session or hand guiding by the device. The service runs both, so no other
        client can end them.
        """
        return self.session != 0 and (self.has_points or self.guided)
