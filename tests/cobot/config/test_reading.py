"""The settings files. Oracle: the messages a person needs, and the REST manual's own `web:` section."""

from __future__ import annotations

from pathlib import Path

import pytest

from cobot.config import load_endpoints, load_settings
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
    assert load_endpoints(settings.web.endpoints) == {}


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
        ("web: {prot: 1}", "web: unknown key 'prot' (did you mean 'port'?); valid keys: enabled, host, port"),
        ("wbe: {}", "unknown key 'wbe' (did you mean 'web'?); valid keys: robot, rt, streaming"),
        (
            "web: {limits: {bodies_bytes: 2000000}}",
            "web.limits: bodies_bytes: is 2000000, but one body may have 33554432 bytes",
        ),
        ("web: {port: 70000}", "web.port: must be less than or equal to 65535, got 70000"),
        ("web: {port: '8007'}", "web.port: must be an integer, got '8007'"),
        ("rt: {clock: slow}", "rt.clock: must be 'realtime' or 'fast', got 'slow'"),
        ("rt: {service_timeout_s: .inf}", "rt.service_timeout_s: "),
        ("robot: {name: '../../etc'}", "robot.name: "),
        ("robot: {backend: {type: fri, 5: 6}}", "the key 5 is not a string: the names of the "),
        ("robot: {model: 7}", "robot.model: must be a path, got 7"),
        (
            "robot: {model: pkg://no_such_package/x.xml}",
            "the Python package 'no_such_package' is not installed",
        ),
        ("robot: {model: pkg://config/../../x.xml}", "is outside the package 'config'"),
        ("web: {port: 1, port: 2}", "'port' occurs twice"),
        ("web: [", "not valid YAML"),
        ("robot: {name: 2001-99-99}", "not valid YAML: month must be in 1..12"),
        (f"web: {{port: {'9' * 5000}}}", "not valid YAML: Exceeds the limit"),
        ("? [a, b]\n: 1", "not valid YAML"),
        ("? {a: b}\n: 1", "not valid YAML"),
        ("web: !!binary x", "not valid YAML"),
        ("logs: ~nosuchuser/x", "~nosuchuser/x: "),
        ('logs: "a\\0b"', "logs: must be a path"),
        ("web: {host: ''}", "web.host: "),
        ("ros: {peers: [robot-pc]}", "ros.peers[0]: 'robot-pc' is not an IPv4 address, such as 192.168.0.20"),
        ("ros: {peers: [10.0.0.2]}", "ros.peers: ['10.0.0.2'] cannot be reached: set ros.localhost_only to"),
        ("rt: {service_timeout_s: 0.001}", "rt.service_timeout_s: "),
        ("rt: {settle_time_s: 100.0}", "rt.settle_time_s: "),
        ("rt: {tracking_error_rad: 1.0e-12}", "rt.tracking_error_rad: "),
        ("web: {stale_after_s: 1.0e-6}", "web.stale_after_s: "),
        ("planning: {max_linear_velocity: 1.0e-300}", "planning.max_linear_velocity: "),
        (
            "fleet: {connect: ['udp/h:1']}",
            "fleet.connect[0]: 'udp/h:1' is not the address of a hub, such as ",
        ),
        ("fleet: {connect: ['tls/h:1']}", "fleet.certificates: tls/h:1 needs the folder"),
        ("fleet: {connect: ['tcp/h:1'], certificates: x}", "fleet.certificates: tcp/h:1 is not encrypted"),
        ("fleet: {accept: {stop: king}}", "fleet.accept.stop: must be"),
        ("fleet: {cell: a/b}", "fleet.cell: "),
        ("fleet: {on_loss: run}", "fleet.on_loss: must be 'continue' or 'stop', got 'run'"),
        ("fleet: {panel: 'javascript:x'}", "fleet.panel: 'javascript:x' is not the address of a panel"),
        ("- a", "must contain a mapping, got list"),
        ("&a [*a]", "must contain a mapping"),
    ],
)
def test_a_mistake_is_named_with_its_place_and_what_is_valid(
    tmp_path: Path, text: str, sentence: str
) -> None:
    path = write(tmp_path, text)
    with pytest.raises(ConfigError) as caught:
        load_settings(path)
    assert sentence in str(caught.value)


SEVERAL = """
rt: {clock: fast, backend: mujoco}
robots:
  - {name: left}
  - name: right
    start_position: work
    backend: package.module:Arm
    joint_limits: slow.yaml
    model: arm.xml
    rt: {cpu: 1}
    planning: {workers: 1}
    streaming: {linear_velocity: 0.1}
"""


def test_each_of_several_robots_has_all_settings_and_only_its_own_differ(tmp_path: Path) -> None:
    settings = load_settings(write(tmp_path, SEVERAL))
    assert list(settings.each) == ["left", "right"]
    left, right = settings.each.values()
    assert settings.of(None).robot == settings.robot == left.robot
    assert (left.rt.clock, left.robot.backend.type, left.rt.cpu) == ("fast", "mujoco", None)
    assert (right.rt.clock, right.robot.backend.type, right.rt.cpu) == ("fast", "package.module:Arm", 1)
    assert (left.robot.start_position, right.robot.start_position) == ("home", "work")
    assert (right.robot.model, right.web.joint_limits) == (tmp_path / "arm.xml", tmp_path / "slow.yaml")
    assert (left.planning.workers, right.planning.workers) == (2, 1)
    assert (left.streaming.linear_velocity, right.streaming.linear_velocity) == (0.5, 0.1)
    assert left.web.model_copy(update={"joint_limits": right.web.joint_limits}) == right.web
    assert settings.of("right") is right
    with pytest.raises(ConfigError, match="there is no robot 'middle'; valid names: left, right"):
        settings.of("middle")


def test_a_robot_section_alone_is_one_robot(tmp_path: Path) -> None:
    settings = load_settings(write(tmp_path, "robot: {name: arm}"))
    assert list(settings.each) == ["arm"]
    assert settings.of("arm") is settings


def test_the_robot_section_says_what_is_the_same_for_all(tmp_path: Path) -> None:
    text = "robot: {name: unused, tcp: tool}\nrobots: [{name: a}, {name: b, tcp: tcp}]"
    assert {name: each.robot.tcp for name, each in load_settings(write(tmp_path, text)).each.items()} == {
        "a": "tool",
        "b": "tcp",
    }


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("robots: []", "robots: must be a list of one or more robots, got []"),
        ("robots:", "robots: must be a list of one or more robots, got null"),
        ("robots: {name: a}", "robots: must be a list of one or more robots, got {"),
        ("robots: [a, b]", "robots[0]: must be a mapping with a name, got 'a'"),
        ("robots: [{name: a}, {model: x.xml}]", "robots[1]: must be a mapping with a name, got {"),
        (
            "robots: [{name: a}, {name: b}, {name: a}]",
            "robots[2]: robots[0] already has the name 'a'; give each robot its own name",
        ),
        (
            "robots: [{name: a, modle: x.xml}]",
            "robots[0]: unknown key 'modle' (did you mean 'model'?); valid keys: name, model, srdf, group,",
        ),
        ("robots: [{name: a, web: {port: 1}}]", "robots[0]: unknown key 'web'"),
        ("robots: [{name: a, 7: x}]", "robots[0]: unknown key '7'"),
        ("robots: [{name: a}, {name: ../b}]", "robots[1]: robot.name: "),
        (
            "robots: [{name: robots}]",
            "robots[0]: robot.name: 'robots' is reserved, because the service has endpoints below",
        ),
        (
            "robots: [{name: v1}]",
            "robots[0]: robot.name: 'v1' is reserved, because the service has endpoints below",
        ),
        ("robots: [{name: 7}]", "robots[0]: robot.name: must be a string, got 7"),
        ("robots: [{name: a, rt: {cup: 1}}]", "robots[0]: rt: unknown key 'cup' (did you mean 'cpu'?)"),
        ("robots: [{name: a, rt: 5}]", "robots[0]: rt: "),
        (
            "robots: [{name: a, backend: x, rt: {backend: y}}]",
            "robots[0]: rt.backend is 'y' and robot.backend is 'x'",
        ),
        ("robots: [{name: a, joint_limits: 7}]", "robots[0]: web.joint_limits: must be a path, got 7"),
        ("robots: [{name: a, name: b}]", "'name' occurs twice"),
        ("robtos: [{name: a}]", "unknown key 'robtos' (did you mean 'robots'?)"),
    ],
)
def test_a_mistake_in_the_list_of_robots_is_named_with_its_place(
    tmp_path: Path, text: str, sentence: str
) -> None:
    path = write(tmp_path, text)
    with pytest.raises(ConfigError) as caught:
        load_settings(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert sentence in str(caught.value)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"nowhere\.yaml: no such file"):
        load_settings(tmp_path / "nowhere.yaml")


def test_binary_is_not_a_settings_file(tmp_path: Path) -> None:
    path = tmp_path / "b.yaml"
    path.write_bytes(bytes(range(256)))
    with pytest.raises(ConfigError, match="cannot be read"):
        load_settings(path)
