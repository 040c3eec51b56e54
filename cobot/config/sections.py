"""All settings, section by section. The files in `config/` explain each setting."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from cobot.config import values
from cobot.config.backend import Backend, Gripper
from cobot.config.locations import Location
from cobot.config.section import Section
from cobot.config.values import (
    Corner,
    FleetName,
    Host,
    IPv4,
    LeastRole,
    Origin,
    PanelUrl,
    Positive,
    Rate,
    RobotName,
    ZenohEndpoint,
)
from cobot.types import MAX_BUDGET_S, TIME_FACTORS, PlannerName


class RobotSection(Section):
    name: RobotName
    model: Location
    srdf: Location
    group: str
    base_frame: str
    tcp: str
    start_position: str
    max_payload_kg: Annotated[float, Field(ge=0.0, le=10_000.0)]
    backend: Backend
    cell: Location | None
    gripper: Gripper


class RtSection(Section):
    clock: Literal["realtime", "fast"]
    time_factor: Annotated[float, Field(ge=TIME_FACTORS[0], le=TIME_FACTORS[1])]
    period_s: Annotated[float, Field(ge=0.0005, le=0.012)]
    priority: Annotated[int, Field(ge=1, le=98)]
    cpu: Annotated[int, Field(ge=0)] | None
    cpu_latency_us: Annotated[int, Field(ge=0, le=1000)] | None
    service_timeout_s: Annotated[float, Field(ge=0.2, le=10.0)]  # a heartbeat comes every 0.05 s
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
    budget_s: Annotated[float, Field(ge=0.0, le=MAX_BUDGET_S)]
    explain_s: Annotated[float, Field(ge=0.0, le=60.0)]
    replan_within_s: Annotated[float, Field(ge=0.0, le=0.5)]
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
    allowed_hosts: list[Host]
    allowed_origins: list[Origin]
    tls_certificate: Location | None
    tls_key: Annotated[Location | None, AfterValidator(values.with_its_certificate)]
    limits: Annotated[ConnectionLimits, AfterValidator(values.with_room_for_a_body)]


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
    peers: Annotated[list[IPv4], AfterValidator(values.for_other_computers)]
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


class FenceSection(Section):
    low: Corner
    high: Annotated[Corner, AfterValidator(values.above_low)]
    speed_m_s: Annotated[float, Field(ge=0.001, le=10.0)]
    payload_kg: Annotated[float, Field(ge=0.0, le=10_000.0)]
    planners: Annotated[list[Annotated[PlannerName, Field(strict=False)]], Field(min_length=1)]
    hours: Annotated[str, Field(pattern=r"^([01]\d|2[0-3]):[0-5]\d-([01]\d|2[0-3]):[0-5]\d$")]


class McpSection(Section):
    enabled: bool
    execution: Literal["off", "approved", "fenced"]
    fence: FenceSection


class AcceptedCommands(Section):
    stop: LeastRole
    program: LeastRole
    speed: LeastRole
    control: LeastRole
    roll_out: LeastRole
    settings: LeastRole
    panel: LeastRole
    panel_commands: LeastRole


class FleetSection(Section):
    name: FleetName
    cell: FleetName | None
    zone: FleetName | None
    connect: list[ZenohEndpoint]
    certificates: Annotated[Location | None, AfterValidator(values.for_its_hub)]
    accept: AcceptedCommands
    recordings: bool
    on_loss: Literal["continue", "stop"]
    loss_s: Annotated[float, Field(ge=1.0, le=3600.0)]
    panel: PanelUrl | None


class LoggingSection(Section):
    format: Literal["text", "json"]
    level: Literal["debug", "info", "warning", "error"]
