"""Backend for KUKA's KR robots over the RobotSensorInterface.

This module is long because it contains all methods of this device that the cycle calls.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import numpy as np

from cobot.config import Settings
from cobot.errors import ConfigError
from cobot.robot.io_points import IoKind, IoPoint
from cobot.robot.model import RobotModel
from cobot.robot.tool import Tool
from cobot.types import Array, JointLimits
from rtloop.backends import BackendError, Capabilities, DeviceStatus, Measured
from rtloop.backends.agreement import ReducedSpeed
from rtloop.backends.beat import Beat, CommandTransition
from rtloop.backends.channel import PacketChannel, UdpChannel
from rtloop.backends.protocols import require_accepted
from rtloop.backends.rsi.corrections import Corrections, FollowWatch
from rtloop.backends.rsi.files import files_for
from rtloop.backends.rsi.options import PERIODS_S, RsiOptions
from rtloop.backends.rsi.session import (
    check_entry,
    check_flange,
    check_position,
    check_readiness,
    check_settings,
    position_at_rest,
)
from rtloop.backends.rsi.telegrams import RobState, decode_rob, encode_sen, layout_of, validity
from rtloop.backends.rsi.xml_reader import MAX_PACKET
from rtloop.results import ACCEPTED, Accepted, Rejected, first_rejection

if TYPE_CHECKING:
    from rtloop.contract import ContractRig

SESSION_GAP_S = 0.04
"""Time without a packet after which the controller may have started RSI again."""
UNCOUNTED = 2
"""Maximum number of late answers that the controller has not counted yet when cobot has."""


class RsiBackend:
    """An externally clocked `Backend` for the robot controller. It also implements `Paced`, `Reporting` and
    `Stepwise`.

    A session lasts from RSI_ON to RSI_OFF. Its corrections start at zero and refer to the arm's position at
    RSI_ON. A new session requires a reset.
    """

    Options = RsiOptions
    capabilities = Capabilities(
        periods_s=tuple(PERIODS_S),
        measured=frozenset({"position", "velocity"}),
        io=True,
        stops={2: False},  # the cabinet switches the drives
        hardware=True,
    )

    def __init__(
        self,
        settings: Settings,
        limits: JointLimits,
        *,
        channel: PacketChannel | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Create the backend. `channel` and `clock` replace the network and its clock in tests."""
        options = settings.backend_options(RsiOptions)
        self._options = options = options if options is not None else RsiOptions()
        fits = options.check_model(limits)
        if isinstance(fits, Rejected):
            raise ConfigError(fits.reason)
        self._limits, self._period_s, self._robot = limits, settings.rt.period_s, settings.robot
        self._step_ms = round(1e3 * self._period_s)
        self._layout = layout_of(options, limits)
        self._is_relative = options.correction == "relative"
        self._reduced = ReducedSpeed()
        self._channel, self._clock = channel, clock
        self._beat: Beat[RobState] = Beat(limits.dof, self._period_s)
        most = np.array(options.limits_of(limits))
        self._corrections = Corrections(
            self._layout, limits, self._period_s, most, relative=self._is_relative
        )
        self._watch = FollowWatch(self._layout, self._period_s, options.follow_rad)
        self._entry = CommandTransition(limits.dof, self._period_s)
        self._heard_s = self._asked_s = self._refused_s = 0.0
        self._enabled = self._asking = self._joins = self._starts = False
        self._answered = True  # whether the newest packet has been answered
        self._answered_state: RobState | None = None  # the newest packet that was answered
        self._seen_ms = self._malformed = 0
        # In this session: number of late answers at its beginning, of packets without an answer, and of
        # unused answers.
        self._delay_before = self._unanswered = self._missed = 0
        self._refused = ""
        self._ended: Accepted | Rejected = ACCEPTED  # Why corrections ended. They begin again after a reset.
        self._silenced = False  # Whether only zeros are sent until the next session.
        self._is_unknown = False  # whether unreported corrections may be in effect
        self._reported = False  # whether this motion's error has been raised
        self._outputs: dict[str, bool] = {}
        self._model: RobotModel | None = None

    def open(self, initial_position: Array) -> None:
        options, robot = self._options, self._robot
        if self._channel is None:
            self._channel = UdpChannel(
                options.listen,
                options.port,
                options.address,
                is_valid=validity(self._layout),
                max_packet=MAX_PACKET,
            )
        self._model = model = RobotModel.load(robot.model, self._limits, base=robot.base_frame, tcp=robot.tcp)
        self._reduced.set_model(model)
        self._asked_s = self._clock()
        self._starts = True
        while not (self.wait(options.silence_s) and self._seen_ms):
            if self._clock() - self._asked_s > options.connect_s:
                raise BackendError(self._no_packet())
            self._answer(None)
        require_accepted(first_rejection(self._checks_of_settings(self._newest)))

    def set_tool(self, tool: Tool) -> None:
        """Set the tool. It only affects the reduced speed in T1, because the load of the drives is set on the
        cabinet.
        """
        self._reduced.set_tool(tool)

    def wait(self, timeout_s: float) -> bool:
        """Wait for the controller's next packet. Return at once if a cycle is still due, because packets were
        lost or have accumulated.
        """
        deadline_s = self._clock() + timeout_s
        while not self._beat.due:
            for packet in self._open_channel.receive(deadline_s - self._clock()):
                self._take(packet)
            if not self._beat.due and self._clock() >= deadline_s:
                return False
        self._beat.advance()
        return True

    def read(self, measured: Measured) -> None:
        state = self._beat.newest
        if state is None or self._silence_s > self._options.silence_s:
            self._end(Rejected("the controller has been silent"))
            raise BackendError(self._explain_silence())
        measured.position, measured.velocity = self._beat.position, self._beat.velocity

    def write(self, command: Array) -> None:
        state = self._beat.newest
        if state is None or self._beat.due or self._answered:
            self._require_corrections()
            return
        result = check_readiness(state) if self._enabled else ACCEPTED
        if isinstance(result, Rejected):
            self._end(result)
        target = None
        if self._enabled:
            if self._joins:
                self._entry.forget()
                self._entry.begin(self._corrections.position, command[0])
                self._joins = False
            target = self._entry.follow(command[0])
            self._entry.pass_period()
        followed = self._follow(state) if self._enabled else ACCEPTED
        self._answer(target if self._enabled else None)
        if self._enabled:
            self._report(first_rejection((followed, self._corrections.check_limit(command[1]))))
        else:
            self._require_corrections()

    def enable(self) -> None:
        """Enable the corrections. The controller may start before or after cobot. If the robot accepts no
        corrections at the start, the first command reports the reason, and a reset tries again.
        """
        starts, self._starts = self._starts, False
        self.recover_step()
        try:
            while True:
                self._answer(None)  # answers the current packet, because no cycle is running yet
                if self.enable_step():
                    return
                self.wait(self._options.silence_s)
        except BackendError as exc:
            if not starts:
                raise
            self._ended = Rejected(str(exc))

    def enable_step(self) -> bool:
        if self._enabled:
            return True
        state, now_s = self._newest, self._clock()
        if not self._asking:
            self._asking, self._asked_s = True, now_s
        result = first_rejection(self._checks_of_enabling(state))
        if isinstance(result, Rejected):
            ready = isinstance(check_readiness(state), Rejected)
            if ready and not state.is_stopped and now_s - self._asked_s <= self._options.enable_s:
                return False
            self._asking = False
            raise BackendError(result.reason)
        self._asking, self._enabled, self._joins = False, True, True
        self._watch.forget()
        return True

    def recover_step(self) -> bool:
        """Wait for the recovery, which the controller's own program carries out. Until it is done, the arm
        only holds its position.
        """
        self._enabled, self._ended, self._reported = False, ACCEPTED, False
        return True

    def disable(self) -> None:
        """Hold the last correction. The controller's program decides what happens to its motion."""
        self._enabled = False

    def close(self) -> None:
        if self._channel is not None:
            self._channel.close()

    def status(self) -> DeviceStatus:
        state = self._beat.newest
        if state is None:
            return DeviceStatus(connection="no packet yet", text=self._no_packet())
        silent = self._silence_s > self._options.silence_s
        share = self._reduced.share if state.operation_mode == "T1" else 1.0
        ready = check_readiness(state)
        return DeviceStatus(
            connection="SILENT" if silent else "RSI is on",
            quality="" if state.delay is None else f"{state.delay} answers late since RSI_ON",
            operation_mode="AUT" if state.operation_mode == "EXT" else state.operation_mode,
            safety_stop="$ALARM_STOP: an emergency stop or a safety stop" if state.is_stopped else "",
            drives="" if state.is_ready is None else "on" if state.is_ready else "off",
            speed_scaling=share * (1.0 if state.override is None else state.override),
            packets_lost=self._beat.lost,
            device_time_s=1e-3 * state.ipoc,
            text="; ".join(filter(None, self._sentences(state, ready, silent=silent))),
        )

    def _sentences(self, state: RobState, ready: Accepted | Rejected, *, silent: bool) -> Iterator[str]:
        if silent:
            yield self._explain_silence()
        elif isinstance(ready, Rejected):
            yield ready.reason
        if state.operation_mode == "EXT":
            yield "the operation mode is EXT: another controller starts the program"
        if state.override is not None and state.override < 1.0:
            yield f"program override {100.0 * state.override:.0f} %"
        count = self._open_channel.strangers
        if count:
            yield f"{count} packets from addresses other than the controller's were ignored"
        if self._malformed:
            yield f"{self._malformed} packets were rejected, the last one for this reason: {self._refused}"

    def io(self) -> list[IoPoint]:
        state, options = self._newest, self._options
        groups = ((options.inputs, state.inputs, False), (options.outputs, state.outputs, True))
        return [
            IoPoint(name, IoKind.BOOLEAN, is_output, float(value))
            for names, values, is_output in groups
            for name, value in zip(names, values, strict=False)
        ]

    def set_output(self, name: str, value: float) -> None:
        if name not in self._options.outputs:
            raise BackendError(f"{name} is not one of the outputs in robot.backend.outputs")
        if self._silence_s > self._options.silence_s:
            raise BackendError(f"{name} cannot be set: {self._explain_silence()}")
        self._outputs[name] = bool(value)

    @staticmethod
    def controller_files(settings: Settings, limits: JointLimits) -> dict[str, str]:
        """Return the files for the controller: the text of each, by its path. See the module `files`."""
        return files_for(settings, limits)

    @staticmethod
    def contract_rig(settings: Settings, limits: JointLimits) -> ContractRig:
        """Create a rig with the backend and a simulated controller in one process."""
        from rtloop.backends.rsi.simulator.lockstep import RsiRig

        return RsiRig(settings, limits)

    def _checks_of_settings(self, state: RobState) -> Iterator[Accepted | Rejected]:
        yield check_settings(state, self._seen_ms, self._options, self._period_s)
        if self._is_unknown:
            yield Rejected(
                f"RSI was on before cobot, with {state.delay} late answers, and its context reports no "
                "AxisCorrMon, so the current correction is not known: start the program again while cobot "
                "runs"
            )
        yield check_position(state, self._layout, self._limits)
        if self._options.check_pose and self._model is not None:
            yield check_flange(self._model, state)

    def _checks_of_enabling(self, state: RobState) -> Iterator[Accepted | Rejected]:
        if self._silence_s > self._options.silence_s:
            yield Rejected(self._explain_silence())
        yield check_readiness(state)
        yield from self._checks_of_settings(state)
        if self._silenced:
            yield Rejected("the corrections do not match the controller's mode: start its program again")
        yield check_entry(state, self._options, self._layout, self._corrections.position)

    def _follow(self, state: RobState) -> Accepted | Rejected:
        """Check that the arm follows the corrections. If the controller wrongly adds up absolute corrections,
        only zeros are sent from then on.
        """
        reference = self._corrections.reference
        assert reference is not None
        result = self._watch.check(np.array(state.position), reference)
        if isinstance(result, Rejected) and self._watch.is_summed:
            self._silenced = True
            self._end(result)
        return result

    def _require_corrections(self) -> None:
        """Raise an error if the corrections have ended, because the arm then does not follow commands. Also
        called in cycles without an answer.
        """
        if not self._enabled and isinstance(self._ended, Rejected):
            raise BackendError(f"the robot does not accept commands: {self._ended.reason}")

    def _report(self, result: Accepted | Rejected) -> None:
        """Raise the error, but only once. The cycle then stops the arm with commands, which the arm follows
        until the reset.
        """
        if isinstance(result, Rejected) and not self._reported:
            self._reported = True
            raise BackendError(result.reason)

    def _answer(self, target: Array | None) -> None:
        """Answer the newest packet, unless it has already been answered."""
        state = self._beat.newest
        if state is None or self._answered or self._is_unknown:
            return
        before = self._answered_state
        periods = self._periods_between(state, before) if before is not None else 1
        self._answered, self._answered_state = True, state
        values = self._corrections.answer(target, periods)
        if self._silenced:
            values = np.zeros_like(values)
        self._watch.add(self._corrections.position, values, relative=self._is_relative)
        outputs = [
            self._outputs.get(name, now)
            for name, now in zip(self._options.outputs, state.outputs, strict=False)
        ]
        self._open_channel.send(encode_sen(self._layout, state.ipoc, values.tolist(), outputs))

    def _take(self, packet: bytes) -> None:
        state = decode_rob(packet, self._layout)
        if isinstance(state, str):
            self._malformed += 1
            self._refused, self._refused_s = state, self._clock()
            return
        before, silence_s, answered = self._beat.newest, self._silence_s, self._answered
        passed_ms = 0 if before is None else state.ipoc - before.ipoc
        if not self._beat.take(state, state.ipoc // self._step_ms, state.position):
            return
        if before is not None and 0 < passed_ms < 20 * self._step_ms:
            self._seen_ms = passed_ms if self._seen_ms == 0 else min(self._seen_ms, passed_ms)
        if before is None or self._is_new_session(before, state, passed_ms, silence_s):
            self._begin_session(state, is_first=before is None)
        elif self._find_loss(state, passed_ms // self._step_ms - int(answered)):
            self._corrections.take_back()
        self._answered, self._heard_s = False, self._clock()
        self._corrections.settle(state)

    def _is_new_session(self, before: RobState, state: RobState, passed_ms: int, silence_s: float) -> bool:
        """Whether RSI was started again since the previous packet."""
        if passed_ms <= 0:
            return True
        if state.delay is not None and before.delay is not None and state.delay < before.delay:
            return True
        if silence_s < SESSION_GAP_S and passed_ms < 1e3 * SESSION_GAP_S:
            return False
        if state.correction and not self._corrections.agree(position_at_rest(state), state.correction):
            return True
        if state.delay is None or before.delay is None:
            return not state.correction
        return state.delay - before.delay < passed_ms // self._step_ms - 1 - UNCOUNTED

    def _begin_session(self, state: RobState, *, is_first: bool) -> None:
        """Begin a session at the controller's position. Corrections begin only after a reset."""
        set_position = np.array(position_at_rest(state))
        correction = np.array(state.correction) if state.correction else np.zeros(self._limits.dof)
        self._corrections.begin(set_position - correction, correction)
        self._delay_before, self._unanswered, self._missed = state.delay or 0, 0, 0
        self._watch.forget()
        self._silenced = False
        self._is_unknown = is_first and not state.correction and bool(state.delay)
        self._outputs.clear()
        if not is_first:
            self._end(
                Rejected("the controller's program has started RSI again, so its corrections begin at zero")
            )

    def _find_loss(self, state: RobState, unanswered: int) -> bool:
        """Whether the controller has missed another answer. Its count of late answers has then increased by
        more than the number of unanswered packets.

        Args:
            unanswered: number of packets without an answer since the previously received one.
        """
        if state.delay is None:
            return False
        self._unanswered += unanswered
        missed = state.delay - self._delay_before - self._unanswered
        found, self._missed = missed > self._missed, max(missed, self._missed)
        return found

    def _end(self, result: Rejected) -> None:
        """End the corrections. The arm stays where it is until a reset."""
        if self._enabled:
            self._enabled, self._ended = False, result

    def _periods_between(self, newer: RobState, older: RobState) -> int:
        return round((newer.ipoc - older.ipoc) / self._step_ms)

    @property
    def _silence_s(self) -> float:
        return self._clock() - self._heard_s

    @property
    def _newest(self) -> RobState:
        if self._beat.newest is None:
            raise BackendError(self._no_packet())
        return self._beat.newest

    @property
    def _open_channel(self) -> PacketChannel:
        if self._channel is None:
            raise BackendError("the connection is not open")
        return self._channel

    def _explain_silence(self) -> str:
        silence_s = self._silence_s
        if self._refused_s > self._heard_s:
            return f"no usable packet for {silence_s:.2f} s; the last one was rejected: {self._refused}"
        state = self._beat.newest
        late = state.delay if state is not None else None
        return (
            f"no packet from the robot controller for {silence_s:.2f} s: RSI has ended (enabling switch "
            "released, emergency stop, a limit of the RSI context, or the program has ended), or the network "
            "is down; the smartPAD shows which. Start the program again, then reset"
            + (f". {late} answers were late before" if late else "")
        )

    def _no_packet(self) -> str:
        options = self._options
        whom = f"from {options.address} " if options.address else ""
        sentence = (
            f"no packet {whom}on UDP port {options.port}: is the controller's program running, and do "
            "IP_NUMBER and PORT of its Ethernet configuration lead to this computer?"
        )
        return f"{sentence} The last packet was rejected: {self._refused}" if self._refused else sentence
