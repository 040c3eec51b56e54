"""Feeds pass a session's targets to its source: the newest setpoint, or points from a queue.

The arm is held if a target is invalid, if there has been no target for too long, or if it would stop too
close to an obstacle. A stream of setpoints then continues with the next target; a servo session ends.
"""

import numpy as np

from cobot.ipc.layout import Intervention

from cobot.arrays cimport MAX_DOF, doubles
from rtloop.sources.source cimport FINE, NOT_FINITE, chunk_fields, setpoint_fields

cdef int COUNT_NOT_FINITE = Intervention.NOT_FINITE
cdef int COUNT_JUMP = Intervention.JUMP
cdef int COUNT_COMMAND_TIMEOUT = Intervention.COMMAND_TIMEOUT
cdef int COUNT_COLLISION = Intervention.COLLISION
cdef int COUNT_PROXIMITY = Intervention.PROXIMITY
cdef int COUNT_LATE = Intervention.LATE

# A client with a longer stated period is not silent yet.
cdef int PERIODS_TO_TIMEOUT = 3
# Maximum time in which a servo session uses its remaining points after a request to end.
cdef double FINISH_S = 1.0
# For the first target: the assumed time since the last one, or one command period if that is longer.
cdef double DEFAULT_INTERVAL_S = 0.01


cdef class Feed:
    """The common part of both kinds of session. Methods with the prefix `c_` are real-time safe.

    Attributes:
        holding: whether the arm must stop and wait for the next target.
        not_finite: whether a streamed value is not finite; `source.explain` names it.
        problem: reason why the session cannot continue, 0 while it can; see `Problem` in feed.pxd.
    """

    def __init__(self, Source source, Safety safety, CollisionMonitor monitor, StreamInbox box,
                 double period_s):
        self.source = source
        self.safety = safety
        self.monitor = monitor
        self.box = box
        self.period_s = period_s
        self.problem = NO_PROBLEM
        self.holding = self.not_finite = self.blocked = self.slowed = False

    def advance(self, external_effort, wrench, double robot_time_s):
        """Advance by one period. Arguments: external torques on the joints (dof,), N·m, and the external
        wrench at the TCP (6,) in the base frame.
        """
        torques, exerted = np.array(external_effort, float), np.array(wrench, float)
        self.c_advance(doubles(torques, self.source.dof), doubles(exerted, 6), robot_time_s)

    def watch_surroundings(self):
        """Slow down near obstacles, and hold the arm if it would stop too close to them."""
        self.c_watch_surroundings()

    cdef void c_advance(self, const double* external_effort, const double* wrench,
                        double robot_time_s) noexcept nogil:
        """Like `advance`. The result is in `holding`, `problem` and `source.reference`."""

    cdef void c_watch_surroundings(self) noexcept nogil:
        """Like `watch_surroundings`, for compiled code."""
        cdef double share
        cdef double state[3 * MAX_DOF]
        # The velocities in the command are stated by the client, so the actual motion is used instead.
        self.safety.c_motion(state)
        self.monitor.c_look(state)
        share = self.monitor.share
        if share < 1.0 and not self.slowed:
            self.safety.c_count(COUNT_PROXIMITY)
        self.slowed = share < 1.0
        self.safety.c_slow_down(share)
        if self.monitor.blocked and not self.holding:
            self.blocked = True
            self.c_hold(COUNT_COLLISION)

    cdef void c_judge(self, int flaw) noexcept nogil:
        """Follow the last target or hold, depending on its flaw."""
        cdef double heading[MAX_DOF]
        if flaw == NOT_FINITE:
            self.safety.c_count(COUNT_NOT_FINITE)
            self.not_finite = True
        elif flaw != FINE:
            self.c_hold(flaw - 1)
        elif self.blocked:
            self.source.c_heading(heading)
            # An arm that is still moving there decelerates first, because at a high speed a step says little.
            self.blocked = self.monitor.blocked or not self.monitor.c_leads_away(
                self.safety.c_command, heading
            )
            self.holding = self.blocked
        elif self.monitor.inside:
            self.source.c_heading(heading)
            self.c_follow_unless_deeper(heading)
        else:
            self.holding = False

    cdef void c_follow_unless_deeper(self, const double* heading) noexcept nogil:
        """Inside the margin, hold the arm if a joint step in this direction leads further inside.

        Watching the surroundings alone would stop the arm only after it has begun to move, so a client that
        begins again and again would come a little closer each time.
        """
        if self.monitor.c_leads_deeper(self.safety.c_command, heading):
            self.blocked = True
            self.c_hold(COUNT_COLLISION)
        else:
            self.holding = False

    cdef void c_hold(self, int why) noexcept nogil:
        if not self.holding:
            self.safety.c_count(why)
        self.holding = True

    cdef void c_end(self, Problem problem) noexcept nogil:
        """Mark the session as unable to continue. Only the problem from the first call is kept."""
        if self.problem == NO_PROBLEM:
            self.problem = problem


cdef class TargetFeed(Feed):
    """The feed for setpoints, of which the newest is used every few cycles, for moves to a pose, and for
    chunks of timed targets.

    Attributes:
        setpoint_seen, move_seen, chunk_seen: numbers of the last processed setpoint, move and chunk.
    """

    def __init__(self, Source source, Safety safety, CollisionMonitor monitor, StreamInbox box,
                 double period_s, request, long long timeout_cycles):
        """`request` is the request for the session, a record of `cobot.ipc.layout.session_dtype`."""
        super().__init__(source, safety, monitor, box, period_s)
        self.has_joints = isinstance(source, JointSource)
        self.has_poses = isinstance(source, CartesianSource)
        self.joints = source if self.has_joints else None
        self.poses = source if self.has_poses else None
        self.setpoint = setpoint_fields(box.setpoint.block)
        self.chunk = chunk_fields(box.chunk.block)
        self.session = int(request["number"])
        self.decimation = int(request["decimation"])
        self.patience_cycles = max(timeout_cycles, PERIODS_TO_TIMEOUT * self.decimation)
        self.setpoint_seen = self.move_seen = self.chunk_seen = self.cancel_seen = 0
        self.live = self.target_waits = False
        self.silent_cycles = self.starved = 0
        self.untaken_cycles = self.decimation  # the first target is used at once

    @property
    def move_running(self):
        return self.c_move_running()

    cdef void c_advance(self, const double* external_effort, const double* wrench,
                        double robot_time_s) noexcept nogil:
        cdef long long starved
        self.silent_cycles += 1
        self.untaken_cycles += 1
        self.c_read_setpoint()
        if self.box.chunk.c_take_news():
            self.c_take_chunk(robot_time_s)
        if self.live and self.silent_cycles > self.patience_cycles:
            self.live = False
            self.c_hold(COUNT_COMMAND_TIMEOUT)
        if not self.holding:
            self.source.c_advance(external_effort, wrench)
        if self.has_joints:
            starved = self.joints.c_starved()
            if starved != self.starved:
                self.starved = starved
                self.safety.c_count(COUNT_COMMAND_TIMEOUT)

    cdef bint c_move_running(self) noexcept nogil:
        return self.has_poses and self.poses.move_running

    cdef void c_read_setpoint(self) noexcept nogil:
        """Read new data from the client: a move at once, a setpoint when one is due."""
        if self.box.setpoint.c_take_news():
            self.target_waits = True
            if self.has_poses and self.setpoint.session[0] == self.session:
                self.c_take_move()
        if self.target_waits and self.box.setpoint.readable and self.untaken_cycles >= self.decimation:
            self.target_waits = False
            self.c_take()

    cdef void c_take(self) noexcept nogil:
        cdef unsigned long long number = self.setpoint.number[0]
        cdef double interval_s
        if self.setpoint.session[0] != self.session or number == self.setpoint_seen:
            return
        self.untaken_cycles = 0
        interval_s = max(DEFAULT_INTERVAL_S, self.decimation * self.period_s)
        if self.setpoint_seen:
            interval_s = self.silent_cycles * self.period_s
        self.setpoint_seen = number
        if self.c_move_running():
            return
        self.silent_cycles = 0
        self.live = True
        self.c_end_hold()
        self.c_judge(self.source.c_take(&self.setpoint, interval_s))

    cdef void c_take_move(self) noexcept nogil:
        cdef unsigned long long move = self.setpoint.move[0], cancel = self.setpoint.cancel[0]
        if move != self.move_seen:
            self.move_seen = move
            self.live = False
            self.c_end_hold()
            self.c_judge(self.poses.c_start_move(self.setpoint.move_pose, self.setpoint.move_duration_s[0]))
        if cancel != self.cancel_seen:
            self.cancel_seen = cancel
            if cancel == self.move_seen and self.poses.move_running:
                self.poses.c_cancel_move()
                self.holding = True

    cdef void c_take_chunk(self, double robot_time_s) noexcept nogil:
        cdef long long late
        cdef int flaw
        if self.chunk.session[0] != self.session or not self.has_joints:
            return
        self.chunk_seen = self.chunk.number[0]
        self.c_end_hold()
        late = self.joints.c_late()
        flaw = self.joints.c_take_chunk(&self.chunk, robot_time_s)
        if flaw == FINE or flaw == NOT_FINITE:
            self.live = False
            self.c_judge(flaw)
        if flaw > NOT_FINITE:  # the previous chunk continues instead
            self.safety.c_count(flaw - 1)
        elif self.joints.c_late() != late:
            self.safety.c_count(flaw - 1 if flaw else COUNT_LATE)

    cdef void c_end_hold(self) noexcept nogil:
        """Stop waiting, because there is a target. The source continues from the arm's current state."""
        if self.holding:
            self.source.c_begin(self.safety.c_command)


cdef class PointFeed(Feed):
    """The feed for servo sessions, which uses every point.

    Attributes:
        points: the source that fetches the points. `source` is the same object, or adds force control to it.
    """

    def __init__(self, Source source, ServoSource points, Safety safety, CollisionMonitor monitor,
                 StreamInbox box, PointQueue queue, double period_s, request):
        super().__init__(source, safety, monitor, box, period_s)
        self.points = points
        self.queue = queue
        self.has_force = isinstance(source, CartesianSource)
        self.presses = source if self.has_force else None
        self.setpoint = setpoint_fields(box.setpoint.block)
        self.session = int(request["number"])
        self.watchdog_cycles = round(float(request["watchdog_s"]) / period_s)
        self.silent_cycles = self.finishing_cycles = self.dropped = 0
        self.judged = 0

    @property
    def watchdog_s(self):
        return self.watchdog_cycles * self.period_s

    cdef void c_advance(self, const double* external_effort, const double* wrench,
                        double robot_time_s) noexcept nogil:
        cdef double heading[MAX_DOF]
        cdef bint finishes = self.box.c_finishes()
        self.silent_cycles += 1
        if self.queue.c_poll():
            self.silent_cycles = 0
        elif self.silent_cycles > self.watchdog_cycles and not (self.problem or finishes):
            self.safety.c_count(COUNT_COMMAND_TIMEOUT)
            self.c_end(SERVO_WATCHDOG)
        if self.box.setpoint.c_take_news() and self.setpoint.session[0] == self.session and self.has_force:
            self.presses.c_press(self.setpoint.wrench)
        if finishes:
            self.finishing_cycles += 1
            if self.c_done() or self.finishing_cycles * self.period_s > FINISH_S:
                self.c_end(CLIENT_ENDED)
        if self.points.c_fetch(self.queue) == NOT_FINITE:
            self.safety.c_count(COUNT_NOT_FINITE)
            self.not_finite = True
        if self.points.dropped != self.dropped:
            self.dropped = self.points.dropped
            self.safety.c_count(COUNT_JUMP)
        if self.queue.seen != self.judged and self.monitor.inside and not self.holding:
            self.points.c_heading(heading)
            self.c_follow_unless_deeper(heading)
        self.judged = self.queue.seen
        if not self.holding:
            self.source.c_advance(external_effort, wrench)

    cdef bint c_done(self) noexcept nogil:
        """Whether all points have been used."""
        cdef int index, dof = self.source.dof
        if self.queue.c_waiting() or self.points.c_buffered():
            return False
        for index in range(dof, 3 * dof):
            if self.source.ref[index] != 0.0:
                return False
        return True
