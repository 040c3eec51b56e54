"""The settings files. They are read strictly: an unknown key is an error that lists the valid keys."""

from __future__ import annotations

from cobot.config.endpoints import MIN_STOP_S, EndpointChange, load_endpoints
from cobot.config.locations import Location, resolve
from cobot.config.reading import DEFAULT_SETTINGS, SECTIONS_OF_A_ROBOT, SETTINGS_FILE, load_settings
from cobot.config.rolled_out import advice, load_with_rolled_out
from cobot.config.section import naming
from cobot.config.sections import (
    ConnectionLimits,
    FleetSection,
    LoggingSection,
    McpSection,
    PlanningSection,
    RecordingSection,
    RosSection,
    RtSection,
    SequencesSection,
    StreamingSection,
    WebSection,
)
from cobot.config.settings import Settings

__all__ = [
    "DEFAULT_SETTINGS",
    "MIN_STOP_S",
    "SECTIONS_OF_A_ROBOT",
    "SETTINGS_FILE",
    "ConnectionLimits",
    "EndpointChange",
    "FleetSection",
    "Location",
    "LoggingSection",
    "McpSection",
    "PlanningSection",
    "RecordingSection",
    "RosSection",
    "RtSection",
    "SequencesSection",
    "Settings",
    "StreamingSection",
    "WebSection",
    "advice",
    "load_endpoints",
    "load_settings",
    "load_with_rolled_out",
    "naming",
    "resolve",
]
