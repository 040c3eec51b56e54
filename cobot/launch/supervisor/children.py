"""The processes that the supervisor runs, each with its command line, its file descriptors and its
secrets.
"""

from __future__ import annotations

import os
import secrets
import socket
from pathlib import Path

from cobot.access.authentication import FLEET_TOKEN_VARIABLE, ROS_TOKEN_VARIABLE
from cobot.client.tls import CERTIFICATE_VARIABLE
from cobot.config import Settings
from cobot.launch.process import RUN_MODULE
from cobot.launch.supervisor.child import Child
from cobot.logs.supervision import SupervisorLog

SERVICE, RECORDER = "service", "recorder"


class Children:
    """Describes the processes of one `cobot run`, but starts none of them.

    Args:
        config: the settings file that all processes read.
        source: the settings file that the user edits. The service reads it on a reload.
    """

    def __init__(self, settings: Settings, config: Path, source: Path, log: SupervisorLog) -> None:
        self._settings = settings
        self._config = ["--config", str(config)]
        self._both_files = [*self._config, "--source", str(source)]
        self._log = log
        self._ros_token = secrets.token_urlsafe(32)
        self._fleet_token = secrets.token_urlsafe(32)

    def rtloop(self, robot: str) -> Child:
        """The real-time process of a robot."""
        name = f"rtloop {robot}" if self._settings.robots else "rtloop"
        clock = self._settings.of(robot).rt.clock
        command = [*RUN_MODULE, "rtloop", *self._config, "--robot", robot, "--clock", clock]
        return Child(name, command, self._log)

    def recorder(self) -> Child:
        return Child(RECORDER, [*RUN_MODULE, "cobot.recorder", *self._config], self._log)

    def service(self, listener: socket.socket) -> Child:
        """The web service, which accepts connections on this socket."""
        host, port = listener.getsockname()[:2]
        listening = ["--host", host, "--port", str(port), "--fd", str(listener.fileno())]
        losses = self._log.losses
        command = [*RUN_MODULE, "app", *self._both_files, "--losses-fd", str(losses), *listening]
        tokens = {ROS_TOKEN_VARIABLE: self._ros_token}
        if self._settings.fleet.connect:
            tokens[FLEET_TOKEN_VARIABLE] = self._fleet_token
        return Child(SERVICE, command, self._log, (listener.fileno(), losses), tokens)

    def fleet(self, url: str) -> Child:
        """The process that connects this cell to a fleet, if it belongs to one. It is a service client."""
        command = [*RUN_MODULE, "cobot.fleet.cell", *self._both_files, *(("--url", url) if url else ())]
        environment = {FLEET_TOKEN_VARIABLE: self._fleet_token} | self._certificate()
        return Child("fleet", command, self._log, environment=environment)

    def ros2(self, url: str) -> Child:
        """The DDS process. If `url` is given, the process is a client of the service at this URL."""
        # Data that a DDS process leaves for its successor. The file is removed when the supervisor ends.
        participant_record = os.memfd_create("cobot-ros2")
        arguments = ["--participant-record", str(participant_record), *(("--url", url) if url else ())]
        command = [*RUN_MODULE, "cobot.dds", *self._config, *arguments]
        environment = {ROS_TOKEN_VARIABLE: self._ros_token} | self._certificate()
        return Child("ros2", command, self._log, (participant_record,), environment)

    def _certificate(self) -> dict[str, str]:
        """The certificate of the service, which its clients must trust."""
        file = self._settings.web.tls_certificate
        return {CERTIFICATE_VARIABLE: str(file)} if file else {}
