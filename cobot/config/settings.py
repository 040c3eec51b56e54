"""All settings of a robot, and the paths of files derived from them."""

from __future__ import annotations

from pathlib import Path

from cobot.config.backend import options_of
from cobot.config.locations import Location
from cobot.config.section import Model, Section
from cobot.config.sections import (
    FleetSection,
    LoggingSection,
    McpSection,
    PlanningSection,
    RecordingSection,
    RobotSection,
    RosSection,
    RtSection,
    SequencesSection,
    StreamingSection,
    WebSection,
)
from cobot.errors import ConfigError


class Settings(Section):
    """The content of `cobot-setting.yaml` for one robot.

    Attributes:
        robots: settings of each robot, if the file has a list `robots`. The first is the default robot, and
            the other attributes are its settings.
    """

    robot: RobotSection
    rt: RtSection
    streaming: StreamingSection
    planning: PlanningSection
    web: WebSection
    sequences: SequencesSection
    recording: RecordingSection
    ros: RosSection
    mcp: McpSection
    fleet: FleetSection
    logs: Location
    kept: Location | None
    logging: LoggingSection
    robots: tuple[Settings, ...] = ()

    @property
    def log_file(self) -> Path:
        return self.logs / f"{self.robot.name}.log"

    @property
    def audit_file(self) -> Path:
        return self.logs / f"{self.robot.name}.audit.jsonl"

    @property
    def keys_file(self) -> Path:
        """File of idempotency keys, written by the service."""
        return (self.kept or self.logs) / f"{self.robot.name}.keys.sqlite"

    @property
    def jobs_file(self) -> Path:
        """File of the results of motions, written by the service."""
        return (self.kept or self.logs) / f"{self.robot.name}.jobs.jsonl"

    @property
    def recording_folder(self) -> Path:
        """Folder of this robot's recordings, created by the recorder."""
        return (self.recording.folder or self.logs / "mcap") / self.robot.name

    @property
    def scene_file(self) -> Path:
        """File of the objects around the robot, written by the service."""
        return (self.kept or self.logs) / f"{self.robot.name}.scene.json"

    @property
    def programs_folder(self) -> Path:
        """Folder of the programs that users have stored, written by the service."""
        return (self.kept or self.logs) / f"{self.robot.name}.programs"

    @property
    def studies_folder(self) -> Path:
        """Folder of the results of studies, written by the service."""
        return (self.kept or self.logs) / f"{self.robot.name}.studies"

    @property
    def positions_file(self) -> Path:
        """File of the named positions that people have taught, written by the service."""
        return (self.kept or self.logs) / f"{self.robot.name}.positions.json"

    @property
    def bundle_file(self) -> Path:
        """File of the newest bundle and the settings that it replaced, written by the cell's process."""
        return (self.kept or self.logs) / f"{self.robot.name}.bundle.json"

    @property
    def restart_file(self) -> Path:
        """File that lists the changes of a rolled-back bundle for which a restart is needed. The cell's
        process writes it.
        """
        return (self.kept or self.logs) / f"{self.robot.name}.restart.json"

    @property
    def rolled_out(self) -> Path:
        """Link to the settings folder that a fleet has rolled out, created by the cell's process."""
        return (self.kept or self.logs) / f"{self.robot.name}.rolled-out" / "current"

    @property
    def tool_file(self) -> Path:
        """File of the tool on the robot's flange, written by the service."""
        return (self.kept or self.logs) / f"{self.robot.name}.tool.json"

    def backend_options(self, kind: type[Model]) -> Model:
        """The options in `robot.backend`, as an instance of the backend's model.

        Raises:
            ConfigError: a key is unknown (the error lists the valid ones) or a value is wrong.
        """
        return options_of(self.robot.backend, kind)

    @property
    def each(self) -> dict[str, Settings]:
        """The settings of each robot by name, the default robot first."""
        return {settings.robot.name: settings for settings in self.robots or (self,)}

    def of(self, robot: str | None) -> Settings:
        """The settings of one robot; None means the default robot.

        Raises:
            ConfigError: no robot has this name. The error lists the valid names.
        """
        if robot is None:
            return self
        if robot not in self.each:
            raise ConfigError(f"there is no robot {robot!r}; valid names: {', '.join(self.each)}")
        return self.each[robot]
