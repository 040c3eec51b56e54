"""All settings together, and the files that follow from them."""

from __future__ import annotations

from pathlib import Path

from cobot.config.backend import options_of
from cobot.config.locations import Location
from cobot.config.section import Model, Section
from cobot.config.sections import (
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
    """`cobot-setting.yaml`, as it is for one robot.

    Attributes:
        robots: of all robots, each as if it were the only one, where the file has a list `robots`; the first
            is the default robot, whose settings the other attributes are.
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
    def jobs_file(self) -> Path:
        """What became of motions; the service writes it."""
        return (self.kept or self.logs) / f"{self.robot.name}.jobs.jsonl"

    @property
    def recording_folder(self) -> Path:
        """Of this robot's recordings; the recorder makes it."""
        return (self.recording.folder or self.logs / "mcap") / self.robot.name

    @property
    def scene_file(self) -> Path:
        """What stands around the robot; the service writes it."""
        return (self.kept or self.logs) / f"{self.robot.name}.scene.json"

    @property
    def positions_file(self) -> Path:
        """Named positions that people have taught; the service writes it."""
        return (self.kept or self.logs) / f"{self.robot.name}.positions.json"

    @property
    def tool_file(self) -> Path:
        """What is on the robot's flange; the service writes it."""
        return (self.kept or self.logs) / f"{self.robot.name}.tool.json"

    def backend_options(self, kind: type[Model]) -> Model:
        """What stands beside `type` in `robot.backend`, as that backend's own model of it.

        Raises:
            ConfigError: an unknown key, with those that are valid, or a wrong value.
        """
        return options_of(self.robot.backend, kind)

    @property
    def each(self) -> dict[str, Settings]:
        """The settings of each robot by its name, those of the default robot first."""
        return {settings.robot.name: settings for settings in self.robots or (self,)}

    def of(self, robot: str | None) -> Settings:
        """Those of one robot, of the default one for None.

        Raises:
            ConfigError: there is no such robot; lists the valid names.
        """
        if robot is None:
            return self
        if robot not in self.each:
            raise ConfigError(f"there is no robot {robot!r}; valid are: {', '.join(self.each)}")
        return self.each[robot]
