"""The settings files, read strictly: an unknown key is an error that lists the valid ones."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import yaml
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, ValidationInfo

from cobot.errors import ConfigError
from cobot.strict import StrictModel, sentence, unknown_key

Model = TypeVar("Model", bound=BaseModel)

DEFAULT_SETTINGS = "pkg://config/cobot-setting.yaml"

LEAST_STOP_S = 4.0
"""A stop may take some 2.5 s, see rtloop."""
ENDPOINTS = (
    "GET /robot/joint_states",
    "GET /robot/pose",
    "GET /robot/positions",
    "POST /robot/move/named",
    "POST /robot/move/pose",
    "POST /robot/move/joints",
    "POST /robot/reset",
    "POST /trajectory/send",
    "POST /trajectory/send_csv",
    "GET /trajectory/logs",
    "POST /sequences/start",
    "GET /sequences/status",
    "GET /sequences/logs",
    "POST /stop",
    "GET /health",
    "WS /robot/stream",
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


class Section(StrictModel):
    """Base of all sections."""

    model_config = ConfigDict(frozen=True)


class RobotSection(Section):
    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,48}$")]
    model: Location
    srdf: Location
    group: str
    base_frame: str
    tcp: str
    start_position: str


class RtSection(Section):
    backend: str
    clock: Literal["realtime", "fast"]
    period_s: Annotated[float, Field(ge=0.0005, le=0.01)]
    priority: Annotated[int, Field(ge=1, le=98)]
    cpu: Annotated[int, Field(ge=0)] | None
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
    collision_margin_m: Annotated[float, Field(ge=0.0, le=0.2)]
    slow_down_m: Annotated[float, Field(ge=0.01, le=1.0)]
    yield_rad: Annotated[float, Field(ge=0.01, le=1.5)]


class PlanningSection(Section):
    default_frame: str
    timeout_s: Positive
    workers: Annotated[int, Field(ge=1, le=16)]
    collision_margin_m: Annotated[float, Field(ge=0.0, le=0.1)]
    start_tolerance_rad: Annotated[float, Field(ge=1e-5, le=0.1)]
    max_linear_velocity: Rate
    max_linear_acceleration: Rate
    max_linear_jerk: Rate
    max_angular_velocity: Rate
    max_angular_acceleration: Rate
    max_angular_jerk: Rate


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


class SequencesSection(Section):
    recordings: Location
    log_lines: Annotated[int, Field(ge=10, le=1_000_000)]
    stop_timeout_s: Annotated[float, Field(gt=0.0, le=1.5)]


class Settings(Section):
    """`cobot-setting.yaml`."""

    robot: RobotSection
    rt: RtSection
    streaming: StreamingSection
    planning: PlanningSection
    web: WebSection
    sequences: SequencesSection
    logs: Location

    @property
    def log_file(self) -> Path:
        return self.logs / f"{self.robot.name}.log"


class Endpoint(Section):
    enabled: bool = True
    timeout_s: Positive


class _EndpointsFile(Section):
    endpoints: dict[str, Endpoint]


def load_settings(path: Path | None = None) -> Settings:
    """Read the settings; None reads those that ship with cobot.

    A file of your own needs only the keys that differ from the shipped ones.

    Raises:
        ConfigError: naming the file, the key, the value and what is valid.
    """
    shipped = resolve(DEFAULT_SETTINGS, Path())
    if path is None:
        return _parse(Settings, shipped, _read_mapping(shipped))
    path = path.resolve()
    return _parse(Settings, path, _merged(_read_mapping(shipped), _read_mapping(path)))


def load_endpoints(path: Path) -> dict[str, Endpoint]:
    """Read `api_endpoints.yaml`: an entry for each of `ENDPOINTS`, and no other.

    Raises:
        ConfigError: as above, or an endpoint is missing or unknown, or there would be no stop.
    """
    endpoints = _parse(_EndpointsFile, path, _read_mapping(path)).endpoints
    for name in endpoints:
        if name not in ENDPOINTS:
            raise ConfigError(f"{path}: endpoints: {unknown_key(name, list(ENDPOINTS))}")
    missing = [name for name in ENDPOINTS if name not in endpoints]
    if missing:
        raise ConfigError(f"{path}: endpoints: missing {', '.join(missing)}")
    stop = endpoints["POST /stop"]
    if not stop.enabled or stop.timeout_s < LEAST_STOP_S:
        raise ConfigError(
            f"{path}: POST /stop: must be enabled, with a timeout_s of {LEAST_STOP_S:g} at least: a stop may "
            "take that long"
        )
    return endpoints


def read_yaml(path: Path) -> Any:
    """A YAML file's content; a key that stands twice in a mapping is an error.

    Raises:
        ConfigError: missing, unreadable or malformed.
    """
    try:
        return yaml.load(path.read_text(encoding="utf-8"), _UniqueKeyLoader)
    except FileNotFoundError as exc:
        raise ConfigError(f"{path}: no such file") from exc
    except (OSError, UnicodeDecodeError) as exc:
        raise ConfigError(f"{path}: cannot be read: {exc}") from exc
    except (yaml.YAMLError, RecursionError, ValueError, TypeError) as exc:  # no such date, a list as a key
        raise ConfigError(f"{path}: not valid YAML: {' '.join(str(exc).split())}") from exc


class _UniqueKeyLoader(yaml.SafeLoader):
    """YAML lets a second key win silently; a robot's limits must not depend on that."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen = set()
        for key_node, _ in node.value:
            key = str(key_node.value)
            if key in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f"{key!r} stands twice", key_node.start_mark
                )
            seen.add(key)
        return super().construct_mapping(node, deep)


def _read_mapping(path: Path) -> dict[str, Any]:
    content = read_yaml(path)
    if not isinstance(content, dict):
        raise ConfigError(f"{path}: must hold a mapping, got {type(content).__name__}")
    return content


def _merged(base: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    merged = dict(base)
    for key, value in changes.items():
        both = isinstance(value, dict) and isinstance(base.get(key), dict)
        merged[key] = _merged(base[key], value) if both else value
    return merged


def _parse(kind: type[Model], path: Path, content: dict[str, Any]) -> Model:
    try:
        return kind.model_validate(content, context={"folder": path.parent})
    except ValidationError as exc:
        raise ConfigError(f"{path}: " + "; ".join(map(sentence, exc.errors()))) from exc
