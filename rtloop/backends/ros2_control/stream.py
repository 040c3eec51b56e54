"""An arm behind ros2_control that accepts a command in each cycle.

Commands are sent to a forward command controller, which passes on each position as soon as it arrives. Its
cycle must be as fast as the joint states.

The cycle exchanges datagrams with the process that speaks DDS and never waits for it. A thread polls that
process several times a second for all other facts, and enables the arm for a reset.
"""

from __future__ import annotations

import logging
import threading
import time
from types import MappingProxyType
from typing import Any, Protocol, cast

import numpy as np

from cobot.config import Settings
from cobot.launch.process import leave_real_time
from cobot.robot.device import Capabilities
from cobot.types import Array, JointLimits
from rtloop.backends.compiled import Measured
from rtloop.backends.protocols import BackendError
from rtloop.backends.queued_outputs import QueuedOutputs
from rtloop.backends.ros2_control import words
from rtloop.backends.ros2_control.common import LOOK_S, ControllerClient, options_of
from rtloop.backends.ros2_control.link import ControllerLink
from rtloop.backends.ros2_control.options import Ros2ControlOptions, client_settings, ros_names
from rtloop.backends.ros2_control.stream_link import StreamProcess
from rtloop.backends.ros2_control.stream_rig import StreamRig
from rtloop.backends.threaded_enabling import ThreadedEnabling

log = logging.getLogger("cobot.rtloop")
CLOSE_S = 2.0
ROWS = ("position", "velocity", "effort")
MIN_STATES = 2.0
"""Minimum number of joint states within `rt.frozen_after_s`. With fewer, cobot would wrongly report frozen
values.
"""


class StreamOptions(Ros2ControlOptions):
    """The options for streaming. They are the same as for whole motions; `controller` is the forward command
    controller.
    """

    min_rate_hz: float = 100.0
    state_timeout_s: float = 0.1


class StreamLink(ControllerLink, Protocol):
    """A `ControllerLink` with the additional functions for streaming.

    Attributes:
        threaded: whether a thread polls the facts.
    """

    threaded: bool

    def latest(self, rows: Array) -> float:
        """Write the newest joint state into `rows`, which has shape (3, dof), and return the state's age, s.
        Real-time safe.
        """
        ...

    def command(self, position: Array) -> None:
        """Send a commanded position. Real-time safe."""
        ...


class Ros2ControlStream(ControllerClient):
    """A `Backend` that is also `Stepwise` and reports its status; see the module."""

    Options = StreamOptions
    capabilities = Capabilities(
        measured=frozenset({"position"}), stops=MappingProxyType({2: False}), hardware=True
    )
    way = words.COMMANDS

    def __init__(self, settings: Settings, limits: JointLimits, link: StreamLink | None = None) -> None:
        """Create the backend. `link` replaces the connection in tests.

        Raises:
            ConfigError: the joints or the namespace are wrong.
        """
        options = options_of(settings, StreamOptions)
        made: Any = link or StreamProcess(
            client_settings(options, settings, ros_names(options, limits)), limits.dof
        )
        super().__init__(options, limits, made)
        self._stream = cast(StreamLink, made)
        self._needed_hz = MIN_STATES / settings.rt.frozen_after_s
        self._rows = np.full((3, limits.dof), np.nan)
        self._problem = ""
        self._enabled = False
        self._outputs = QueuedOutputs()
        self._enabling = ThreadedEnabling(self._make_ready, lambda: True)
        self._ending = threading.Event()
        self._thread: threading.Thread | None = None

    @staticmethod
    def contract_rig(settings: Settings, limits: JointLimits) -> StreamRig:
        """Create a rig with a simulated controller in the same process."""
        return StreamRig(Ros2ControlStream, settings, limits)

    def open(self, initial_position: Array) -> None:
        self._stream.open()
        self._await()
        if self._facts.rate_hz < self._needed_hz:
            raise BackendError(
                f"the rate of {self._expected.topic} is {self._facts.rate_hz:.0f} Hz; the minimum for a "
                f"stream is {self._needed_hz:.0f} Hz ({MIN_STATES:g} joint states within "
                "rt.frozen_after_s): raise update_rate of the controller manager, or use the backend "
                "ros2_control"
            )
        self._problem = ""
        if self._stream.threaded:
            self._ending.clear()
            self._thread = threading.Thread(target=self._keep_looking, name="controllers", daemon=True)
            self._thread.start()

    def enable(self) -> None:
        """Check again for faults. The drives are not switched on here, because the driver does that."""
        self.recover_step()
        while not self.enable_step():
            time.sleep(LOOK_S)

    def recover_step(self) -> bool:
        """Stop sending commands, and make the thread check for faults, which may take seconds."""
        self._enabled = False
        self._enabling.begin()
        return True

    def enable_step(self) -> bool:
        if not self._stream.threaded:
            self._enabling.perform()
        if not self._enabling.is_done():
            return False
        self._problem, self._enabled = "", True
        return True

    def read(self, measured: Measured) -> None:
        if not self._stream.threaded:
            self._look()
        if self._problem:
            self._enabled = False  # needed because the thread may be about to overwrite the problem
            raise BackendError(self._problem)
        age_s = self._stream.latest(self._rows)
        if not age_s <= self._options.state_timeout_s:
            self._problem = words.silence_of(self._expected.topic, age_s, self._options.state_timeout_s)
            self._enabled = False
            raise BackendError(self._problem)
        measured.position[:] = self._rows[0]
        for order, row in enumerate(ROWS):
            if row in self._options.measured:
                getattr(measured, row)[:] = self._rows[order]

    def write(self, command: Array) -> None:
        # after a fault the arm may have moved, so commands need a reset first
        if self._enabled and not self._problem:
            self._stream.command(command[0])

    def set_output(self, name: str, value: float) -> None:
        """Set an output at the next poll, because a request to the process would take longer than a cycle."""
        self._outputs.add(self._gpio.place_of(name), value)

    def disable(self) -> None:
        """Stop sending commands. The driver controls the drives, so they stay on."""
        self._enabled = False

    def close(self) -> None:
        self._ending.set()
        if self._thread is not None:
            self._thread.join(CLOSE_S)
            self._thread = None
        self._stream.close()

    def _make_ready(self) -> None:
        self._stream.open()
        self._stream.forget()
        self._await()

    def _keep_looking(self) -> None:
        leave_real_time()
        while not self._ending.wait(LOOK_S):
            self._enabling.perform()
            self._look()

    def _set(self, interface: str, value: float) -> None:
        try:
            self._stream.set_output(interface, value)
        except BackendError as exc:
            log.warning("an output of the device: %s", exc)

    def _look(self) -> None:
        """Set outputs, and store the reason if the arm cannot be moved."""
        try:
            for interface, value in self._outputs.take():
                self._set(interface, value)
            facts = self._look_at_facts()
            self._problem = self._problem or self._of_driver(facts)
        except BackendError as exc:
            self._problem = str(exc)
