"""The settings files, read strictly: an unknown key is an error that lists the valid ones.

Long, as it is the reference of all that can be set.
"""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Iterator
from contextlib import contextmanager
from ipaddress import IPv4Address
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    ValidationInfo,
)

from cobot.addresses import ROBOTS
from cobot.errors import ConfigError
from cobot.strict import StrictModel, sentence, shown, unknown_key
from cobot.types import PlannerName
from cobot.yaml_file import read_mapping

Model = TypeVar("Model", bound=BaseModel)

SETTINGS_FILE = "cobot-setting.yaml"
DEFAULT_SETTINGS = f"pkg://config/{SETTINGS_FILE}"

SECTIONS_OF_A_ROBOT = ("rt", "streaming", "planning")
"""An entry in `robots` may change these sections as a whole."""
MIN_STOP_S = 4.0
"""POST /stop has to be given this timeout at least, s: a stop of the arm may take some 2.5 s."""
ENDPOINTS = (
    "GET /robot/joint_states",
    "GET /robot/pose",
    "GET /robot/positions",
    "GET /robot/geometry",
    "GET /robot/control",
    "POST /robot/control",
    "DELETE /robot/control",
    "POST /robot/move/named",
    "POST /robot/move/pose",
    "POST /robot/move/joints",
    "POST /robot/move/arc",
    "POST /robot/move/sequence",
    "POST /robot/plan/named",
    "POST /robot/plan/pose",
    "POST /robot/plan/joints",
    "POST /robot/plan/arc",
    "POST /robot/plan/path",
    "POST /robot/plan/sequence",
    "POST /robot/execute",
    "GET /robot/plans",
    "POST /robot/approve",
    "GET /robot/tool",
    "POST /robot/tool",
    "GET /scene",
    "POST /scene",
    "POST /robot/reset",
    "POST /trajectory/send",
    "POST /trajectory/send_csv",
    "GET /trajectory/logs",
    "GET /recordings",
    "POST /recordings",
    "GET /recordings/{name}",
    "DELETE /recordings/{name}",
    "POST /sequences/start",
    "GET /sequences/status",
    "GET /sequences/logs",
    "GET /events",
    "WS /events",
    "GET /jobs",
    "GET /jobs/{job}",
    "POST /jobs/{job}/cancel",
    "POST /jobs/{job}/pause",
    "POST /jobs/{job}/resume",
    "POST /jobs/{job}/step",
    "GET /robot/speed_override",
    "POST /robot/speed_override",
    "POST /stop",
    "GET /health",
    "GET /health/live",
    "GET /health/ready",
    "GET /metrics",
    "POST /admin/reload",
    "GET /robots",
    "GET /audit",
    "WS /robot/stream",
    "WS /rosbridge",
    "POST /{robot}/{Class}/{method}",
)


def resolve(location: str, folder: Path) -> Path:
    """The file that a setting names: pkg://PACKAGE/PATH, ~/PATH, or relative to `folder`.

    Raises:
        ConfigError: for a package that is not installed or a path that leaves it.
    """
    if not location.startswith("pkg://"):
        try:
            return (folder / Path(location).expanduser()).resolve()
        except (RuntimeError, OSError, ValueError) as exc:  # no such user, a circle of links, a NUL byte
            raise ConfigError(f"{location}: {exc}") from exc
    package, _, inner = location.removeprefix("pkg://").partition("/")
    try:
        spec = importlib.util.find_spec(package) if package.isidentifier() else None
    except (ImportError, ValueError):
        spec = None
    if spec is None or not spec.submodule_search_locations:
        raise ConfigError(f"{location}: there is no installed Python package {package!r}")
    root = Path(next(iter(spec.submodule_search_locations))).resolve()
    path = (root / inner).resolve()
    if not path.is_relative_to(root):
        raise ConfigError(f"{location}: leaves the package {package!r}")
    return path


def _in_folder(value: object, info: ValidationInfo) -> Path:
    if not isinstance(value, str) or "\0" in value:
        raise ValueError(f"must be a path, got {value!r}")
    return resolve(value, (info.context or {})["folder"])


Location = Annotated[Path, BeforeValidator(_in_folder)]
"""A path in a settings file, resolved against that file's folder."""

Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
Rate = Annotated[float, Field(ge=1e-3, le=1e4)]


def _an_ipv4_address(value: str) -> str:
    try:
        IPv4Address(value)
    except ValueError as exc:
        raise ValueError(f"{shown(value)} is no IPv4 address, such as 192.168.0.20") from exc
    return value


def _a_host(value: str) -> str:
    if not re.fullmatch(r"[a-z0-9_]([a-z0-9._-]*[a-z0-9_])?|[0-9a-f:.]*:[0-9a-f:.]*", value):
        raise ValueError(
            f"{shown(value)} is no name or address of a host, such as robot.example or 192.168.0.10: "
            "in lower case, without a scheme, a port or a wildcard"
        )
    return value


def _an_origin(value: str) -> str:
    if not re.fullmatch(r"[a-z][a-z0-9+.-]*://[^/?#\s@*A-Z]+", value):
        raise ValueError(
            f"{shown(value)} is no origin of pages, such as https://app.example or http://localhost:3000: "
            "a scheme, a host in lower case, and its port if it is not the usual one"
        )
    return value


def _for_other_computers(value: list[str], info: ValidationInfo) -> list[str]:
    if value and info.data.get("localhost_only"):
        raise ValueError(f"{shown(value)} cannot be reached: set ros.localhost_only to false")
    return value


def _both_or_none(key: Path | None, info: ValidationInfo) -> Path | None:
    if (key is None) != (info.data.get("tls_certificate") is None):
        raise ValueError("web.tls_certificate and web.tls_key go together: give both, or neither")
    return key


class Section(StrictModel):
    """Base of all sections. Pydantic builds them with the settings as a whole, not also each by itself."""

    model_config = ConfigDict(frozen=True, defer_build=True)


def _not_a_path(name: str) -> str:
    if f"/{name}" == ROBOTS:
        raise ValueError(f"{name!r} is taken: {ROBOTS}/NAME/... are the endpoints of any robot")
    return name


class RobotSection(Section):
    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,48}$"), AfterValidator(_not_a_path)]
    model: Location
    srdf: Location
    group: str
    base_frame: str
    tcp: str
    start_position: str
    max_payload_kg: Annotated[float, Field(ge=0.0, le=10_000.0)]


class RtSection(Section):
    backend: str
    clock: Literal["realtime", "fast"]
    period_s: Annotated[float, Field(ge=0.0005, le=0.01)]
    priority: Annotated[int, Field(ge=1, le=98)]
    cpu: Annotated[int, Field(ge=0)] | None
    cpu_latency_us: Annotated[int, Field(ge=0, le=1000)] | None
    service_timeout_s: Annotated[float, Field(ge=0.2, le=10.0)]  # a sign of life comes every 0.05 s
    tracking_error_rad: Annotated[float, Field(ge=0.005, le=1.0)]
    settle_position_rad: Annotated[float, Field(ge=1e-5, le=0.1)]
    settle_velocity_rad_s: Annotated[float, Field(ge=1e-4, le=0.5)]
    settle_time_s: Annotated[float, Field(gt=0.0, le=1.0)]
    overruns_to_stop: Annotated[int, Field(ge=2, le=1000)]
    pause_to_stop_s: Annotated[float, Field(ge=0.005, le=1.0)]
    frozen_after_s: Annotated[float, Field(ge=0.005, le=1.0)]
    trajectory_capacity: Annotated[int, Field(ge=100, le=1_000_000)]


class StreamingSection(Section):
    joint_velocity: Rate
    joint_acceleration: Rate
    linear_velocity: Rate
    linear_acceleration: Rate
    linear_jerk: Rate
    angular_velocity: Rate
    angular_acceleration: Rate
    angular_jerk: Rate
    command_timeout_s: Annotated[float, Field(ge=0.01, le=5.0)]
    client_timeout_s: Annotated[float, Field(ge=1.0, le=3600.0)]
    collision_margin_m: Annotated[float, Field(ge=0.0, le=0.2)]
    slow_down_m: Annotated[float, Field(ge=0.01, le=1.0)]
    yield_rad: Annotated[float, Field(ge=0.01, le=1.5)]


class PlanningSection(Section):
    default_frame: str
    timeout_s: Positive
    workers: Annotated[int, Field(ge=1, le=16)]
    collision_margin_m: Annotated[float, Field(ge=0.0, le=0.1)]
    start_tolerance_rad: Annotated[float, Field(ge=1e-5, le=0.1)]
    smoothing_rad: Annotated[float, Field(ge=0.0, le=0.01)]
    kept_plans: Annotated[int, Field(ge=1, le=1000)]
    plan_lifetime_s: Annotated[float, Field(ge=1.0, le=86_400.0)]
    explain_s: Annotated[float, Field(ge=0.0, le=60.0)]
    max_linear_velocity: Rate
    max_linear_acceleration: Rate
    max_linear_jerk: Rate
    max_angular_velocity: Rate
    max_angular_acceleration: Rate
    max_angular_jerk: Rate


class ConnectionLimits(Section):
    connections: Annotated[int, Field(ge=16, le=100_000)]
    connections_per_address: Annotated[int, Field(ge=8, le=100_000)]
    reserve: Annotated[int, Field(ge=4, le=1000)]
    header_bytes: Annotated[int, Field(ge=4096, le=1_048_576)]
    header_timeout_s: Annotated[float, Field(ge=0.5, le=300.0)]
    body_timeout_s: Annotated[float, Field(ge=0.5, le=300.0)]
    body_bytes_per_s: Annotated[int, Field(ge=1)]
    bodies_bytes: Annotated[int, Field(ge=1024)]
    idle_timeout_s: Annotated[float, Field(ge=1.0, le=3600.0)]


def _with_room_for_a_body(limits: ConnectionLimits, info: ValidationInfo) -> ConnectionLimits:
    largest = max(info.data.get(name, 0) for name in ("max_body_bytes", "max_json_bytes"))
    if limits.bodies_bytes < largest:
        raise ValueError(f"bodies_bytes: {limits.bodies_bytes} has no room for one body of {largest} bytes")
    return limits


class WebSection(Section):
    enabled: bool
    host: Annotated[str, Field(min_length=1)]
    port: Annotated[int, Field(ge=0, le=65535)]
    endpoints: Location
    joint_limits: Location
    max_body_bytes: Annotated[int, Field(ge=1024)]
    max_json_bytes: Annotated[int, Field(ge=1024)]
    stop_on_disconnect: bool
    stale_after_s: Annotated[float, Field(ge=0.05, le=1.0)]
    hang_to_restart_s: Annotated[float, Field(ge=2.0, le=3600.0)] | None
    authentication: Literal["auto", "required", "none"]
    tokens: Location
    stop_without_token: bool
    allowed_hosts: list[Annotated[str, AfterValidator(_a_host)]]
    allowed_origins: list[Annotated[str, AfterValidator(_an_origin)]]
    tls_certificate: Location | None
    tls_key: Annotated[Location | None, AfterValidator(_both_or_none)]
    limits: Annotated[ConnectionLimits, AfterValidator(_with_room_for_a_body)]


class SequencesSection(Section):
    recordings: Location
    programs: Location
    log_lines: Annotated[int, Field(ge=10, le=1_000_000)]
    stop_timeout_s: Annotated[float, Field(gt=0.0, le=1.5)]


class RecordingSection(Section):
    folder: Location | None
    ring_s: Annotated[float, Field(ge=5.0, le=600.0)]
    before_s: Annotated[float, Field(ge=0.0, le=600.0)]
    after_s: Annotated[float, Field(ge=0.0, le=60.0)]
    max_mb: Annotated[int, Field(ge=200, le=1_000_000)]


class RosSection(Section):
    enabled: bool
    access: Literal["auto", "observe", "move", "all"]
    domain_id: Annotated[int, Field(ge=0, le=232)]
    localhost_only: bool
    interfaces: list[str]
    peers: Annotated[
        list[Annotated[str, AfterValidator(_an_ipv4_address)]], AfterValidator(_for_other_computers)
    ]
    gid_bytes: Literal["auto", 16, 24]
    joint_states_rate_hz: Annotated[float, Field(ge=1.0, le=1000.0)]
    pose_rate_hz: Annotated[float, Field(ge=1.0, le=1000.0)]
    tf_rate_hz: Annotated[float, Field(ge=1.0, le=1000.0)]
    status_rate_hz: Annotated[float, Field(ge=1.0, le=1000.0)]
    debug: bool
    enable_fjt_action: bool
    fjt_mode: Annotated[int, Field(ge=0, le=7)]
    fjt_time: Annotated[float, Field(ge=0.0, le=10.0)]
    fjt_send_period: Annotated[float, Field(ge=0.0, le=1.0)]


def _from_low_to_high(high: tuple[float, float, float], info: ValidationInfo) -> tuple[float, float, float]:
    low = info.data.get("low")
    if low is not None and not all(a < b for a, b in zip(low, high, strict=True)):
        raise ValueError(f"{high} has to be above low, {low}, in x, y and z")
    return high


Metres = Annotated[float, Field(ge=-1000.0, le=1000.0)]
Corner = Annotated[tuple[Metres, Metres, Metres], Field(strict=False)]


class FenceSection(Section):
    low: Corner
    high: Annotated[Corner, AfterValidator(_from_low_to_high)]
    speed_m_s: Annotated[float, Field(ge=0.001, le=10.0)]
    payload_kg: Annotated[float, Field(ge=0.0, le=10_000.0)]
    planners: Annotated[list[Annotated[PlannerName, Field(strict=False)]], Field(min_length=1)]
    hours: Annotated[str, Field(pattern=r"^([01]\d|2[0-3]):[0-5]\d-([01]\d|2[0-3]):[0-5]\d$")]


class McpSection(Section):
    enabled: bool
    execution: Literal["off", "approved", "fenced"]
    fence: FenceSection


class LoggingSection(Section):
    format: Literal["text", "json"]
    level: Literal["debug", "info", "warning", "error"]


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
    def tool_file(self) -> Path:
        """What is on the robot's flange; the service writes it."""
        return (self.kept or self.logs) / f"{self.robot.name}.tool.json"

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


class Endpoint(Section):
    enabled: bool = True
    timeout_s: Positive


class _EndpointsFile(Section):
    endpoints: dict[str, Endpoint]


def load_settings(path: Path | None = None) -> Settings:
    """Read the settings; None reads those that ship with cobot.

    A file of your own needs only the keys that differ from the shipped ones. Its list `robots`, if it has
    one, holds what each of several robots has otherwise than the rest of the file says.

    Raises:
        ConfigError: naming the file, the key, the value and what is valid.
    """
    shipped = resolve(DEFAULT_SETTINGS, Path())
    content = read_mapping(shipped)
    path = shipped if path is None else path.resolve()
    if path != shipped:
        content = _merged(content, read_mapping(path))
    if "robots" not in content:
        return _parse(Settings, path, content)
    each = [
        _parse(Settings, path, _merged(content, changes), place=f"robots[{index}]: ")
        for index, changes in enumerate(_changes_of_each(path, content.pop("robots")))
    ]
    names = [settings.robot.name for settings in each]
    for index, name in enumerate(names):
        if name in names[:index]:
            first = names.index(name)
            raise ConfigError(
                f"{path}: robots[{index}]: the name {name!r} is that of robots[{first}] already"
            )
    return each[0].model_copy(update={"robots": tuple(each)})


def _changes_of_each(path: Path, entries: Any) -> Iterator[dict[str, Any]]:
    """Of each entry in `robots`: what it changes in the settings as a whole."""
    if not isinstance(entries, list) or not entries:
        raise ConfigError(f"{path}: robots: must be a list of one robot or more, got {shown(entries)}")
    valid = [*RobotSection.model_fields, "backend", "joint_limits", *SECTIONS_OF_A_ROBOT]
    for index, entry in enumerate(entries):
        place = f"{path}: robots[{index}]"
        if not isinstance(entry, dict) or "name" not in entry:
            raise ConfigError(f"{place}: must be a mapping with a name, got {shown(entry)}")
        for key in entry:
            if key not in valid:
                raise ConfigError(f"{place}: {unknown_key(str(key), valid)}")
        changes = {key: entry[key] for key in SECTIONS_OF_A_ROBOT if key in entry}
        changes["robot"] = {key: entry[key] for key in RobotSection.model_fields if key in entry}
        if "backend" in entry:
            rt = changes.get("rt", {})
            if not isinstance(rt, dict) or "backend" in rt:
                raise ConfigError(f"{place}: backend: stands beside rt: {shown(rt)}")
            changes["rt"] = {**rt, "backend": entry["backend"]}
        if "joint_limits" in entry:
            changes["web"] = {"joint_limits": entry["joint_limits"]}
        yield changes


@contextmanager
def naming(setting: str) -> Iterator[None]:
    """Have errors of what a setting names begin with the setting, which is what people can change."""
    try:
        yield
    except ConfigError as exc:
        raise ConfigError(f"{setting}: {exc}") from exc


@naming("web.endpoints")
def load_endpoints(path: Path) -> dict[str, Endpoint]:
    """Read `api_endpoints.yaml`: an entry for each of `ENDPOINTS`, and no other.

    Raises:
        ConfigError: as above, or an endpoint is missing or unknown, or there would be no stop.
    """
    endpoints = _parse(_EndpointsFile, path, read_mapping(path)).endpoints
    for name in endpoints:
        if name not in ENDPOINTS:
            raise ConfigError(f"{path}: endpoints: {unknown_key(name, list(ENDPOINTS))}")
    missing = [name for name in ENDPOINTS if name not in endpoints]
    if missing:
        raise ConfigError(f"{path}: endpoints: missing {', '.join(missing)}")
    stop = endpoints["POST /stop"]
    if not stop.enabled or stop.timeout_s < MIN_STOP_S:
        raise ConfigError(
            f"{path}: POST /stop: must be enabled, with a timeout_s of {MIN_STOP_S:g} at least: a stop may "
            "take that long"
        )
    return endpoints


def _merged(base: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    merged = dict(base)
    for key, value in changes.items():
        both = isinstance(value, dict) and isinstance(base.get(key), dict)
        merged[key] = _merged(base[key], value) if both else value
    return merged


def _parse(kind: type[Model], path: Path, content: dict[str, Any], place: str = "") -> Model:
    try:
        return kind.model_validate(content, context={"folder": path.parent})
    except ValidationError as exc:
        raise ConfigError(f"{path}: {place}" + "; ".join(map(sentence, exc.errors()))) from exc
