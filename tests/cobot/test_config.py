"""The settings files. Oracle: the messages a person needs, and the REST manual's own `web:` section."""

from __future__ import annotations

from pathlib import Path

import pytest

from cobot.config import ENDPOINTS, load_endpoints, load_settings, resolve
from cobot.errors import ConfigError


def write(folder: Path, text: str, name: str = "settings.yaml") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def test_the_shipped_settings_are_valid_and_listen_on_this_machine_only() -> None:
    settings = load_settings()
    assert settings.web.host == "127.0.0.1"
    assert settings.web.port == 8007
    assert settings.web.joint_limits.is_file()
    assert set(load_endpoints(settings.web.endpoints)) == set(ENDPOINTS)


def test_a_file_of_ones_own_changes_only_what_it_names(tmp_path: Path) -> None:
    settings = load_settings(write(tmp_path, "web: {host: 0.0.0.0}\nlogs: logs\n"))
    assert settings.web.host == "0.0.0.0"
    assert settings.web.port == 8007
    assert settings.logs == tmp_path / "logs"


def test_the_manuals_web_section_is_understood(tmp_path: Path) -> None:
    text = """
web:
  enabled: true
  host: 0.0.0.0
  port: 8007
  endpoints: pkg://config/api_endpoints.yaml
  joint_limits: pkg://config/joint_limits.yaml
"""
    assert load_settings(write(tmp_path, text)).web.enabled


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("web: {prot: 1}", "web: unknown key 'prot' (did you mean 'port'?); valid are: enabled, host, port"),
        ("wbe: {}", "unknown key 'wbe' (did you mean 'web'?); valid are: robot, rt, streaming"),
        ("web: {port: 70000}", "web.port: input should be less than or equal to 65535, got 70000"),
        ("web: {port: '8007'}", "web.port: input should be a valid integer, got '8007'"),
        ("rt: {clock: slow}", "rt.clock: input should be 'realtime' or 'fast', got 'slow'"),
        ("rt: {service_timeout_s: .inf}", "rt.service_timeout_s: "),
        ("robot: {name: '../../etc'}", "robot.name: "),
        ("robot: {model: 7}", "robot.model: must be a path, got 7"),
        (
            "robot: {model: pkg://no_such_package/x.xml}",
            "there is no installed Python package 'no_such_package'",
        ),
        ("robot: {model: pkg://config/../../x.xml}", "leaves the package 'config'"),
        ("web: {port: 1, port: 2}", "'port' stands twice"),
        ("web: [", "not valid YAML"),
        ("robot: {name: 2001-99-99}", "not valid YAML: month must be in 1..12"),
        (f"web: {{port: {'9' * 5000}}}", "not valid YAML: Exceeds the limit"),
        ("? [a, b]\n: 1", "not valid YAML"),
        ("? {a: b}\n: 1", "not valid YAML"),
        ("web: !!binary x", "not valid YAML"),
        ("logs: ~nosuchuser/x", "~nosuchuser/x: "),
        ('logs: "a\\0b"', "logs: must be a path"),
        ("web: {host: ''}", "web.host: "),
        ("rt: {service_timeout_s: 0.001}", "rt.service_timeout_s: "),
        ("rt: {settle_time_s: 100.0}", "rt.settle_time_s: "),
        ("rt: {tracking_error_rad: 1.0e-12}", "rt.tracking_error_rad: "),
        ("web: {stale_after_s: 1.0e-6}", "web.stale_after_s: "),
        ("planning: {max_linear_velocity: 1.0e-300}", "planning.max_linear_velocity: "),
        ("- a", "must hold a mapping, got list"),
        ("&a [*a]", "must hold a mapping"),
    ],
)
def test_a_mistake_is_named_with_its_place_and_what_is_valid(
    tmp_path: Path, text: str, sentence: str
) -> None:
    path = write(tmp_path, text)
    with pytest.raises(ConfigError) as caught:
        load_settings(path)
    assert sentence in str(caught.value)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"nowhere\.yaml: no such file"):
        load_settings(tmp_path / "nowhere.yaml")


def test_binary_is_not_a_settings_file(tmp_path: Path) -> None:
    path = tmp_path / "b.yaml"
    path.write_bytes(bytes(range(256)))
    with pytest.raises(ConfigError, match="cannot be read"):
        load_settings(path)


def test_the_endpoints_file_names_all_endpoints_and_no_other(tmp_path: Path) -> None:
    every = "".join(f"  {name}: {{timeout_s: 1.0}}\n" for name in ENDPOINTS)
    with pytest.raises(ConfigError, match="missing POST /stop"):
        load_endpoints(
            write(tmp_path, "endpoints:\n" + every.replace("  POST /stop: {timeout_s: 1.0}\n", ""))
        )
    with pytest.raises(ConfigError, match=r"unknown key 'POST /halt' .*valid are: GET /robot/joint_states"):
        load_endpoints(write(tmp_path, "endpoints:\n" + every + "  POST /halt: {timeout_s: 1.0}\n"))
    for stop in ("{timeout_s: 1.0}", "{enabled: false, timeout_s: 10.0}"):
        other = every.replace("1.0", "5.0").replace("POST /stop: {timeout_s: 5.0}", f"POST /stop: {stop}")
        with pytest.raises(ConfigError, match="POST /stop: must be enabled, with a timeout_s of 4 at least"):
            load_endpoints(write(tmp_path, "endpoints:\n" + other))
    with pytest.raises(ConfigError, match=r"timeout_s: input should be greater than 0"):
        load_endpoints(write(tmp_path, "endpoints:\n" + every.replace("1.0", "0.0")))


def test_a_path_is_relative_to_the_file_that_names_it(tmp_path: Path) -> None:
    assert resolve("a/b.yaml", tmp_path) == tmp_path / "a" / "b.yaml"
    assert resolve("~/x", tmp_path) == Path.home() / "x"
