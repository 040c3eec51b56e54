"""A backend of somebody's own is found by module and class, and driven through the Python protocol.

Oracle: what the backend itself has kept.
"""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
import yaml
from cobot_run import unique_name
from own_arm import Arm, Boasts, BoastsLater
from paced_arm import PacedArm

from cobot.config import Settings, load_settings
from cobot.errors import ConfigError
from cobot.ipc.shm import RobotMemory
from cobot.robot.description import RobotDescription
from rtloop.backends import Capabilities, backend_class, backend_names, capabilities_of, make_backend
from rtloop.backends.registry import REGISTRY
from rtloop.clock import FastClock
from rtloop.loop import ControlLoop

CYCLES = 20


def with_backend(settings: Settings, name: str) -> Settings:
    backend = settings.robot.backend.model_copy(update={"type": name})
    return settings.model_copy(update={"robot": settings.robot.model_copy(update={"backend": backend})})


def test_an_arm_of_ones_own_is_loaded_by_its_name_and_held(
    settings: Settings, robot: RobotDescription
) -> None:
    arm = make_backend(with_backend(settings, "own_arm:Arm"), robot.limits)
    assert isinstance(arm, Arm)
    memory = RobotMemory.create(unique_name(), robot.limits.dof, settings.rt.period_s, 100)
    home = np.array(robot.positions["home"].joints)
    try:
        loop = ControlLoop(settings, robot.model, memory, arm, FastClock(settings.rt.period_s))
        loop.open(home)
        for _ in range(CYCLES):
            loop.step()
        loop.close()
    finally:
        memory.unlink()
        memory.close()
    assert arm.calls == ["open", "enable", "disable", "close"]
    assert len(arm.commands) == CYCLES
    for command in arm.commands:
        assert np.array_equal(command, [home, np.zeros(7), np.zeros(7)])


@pytest.mark.parametrize("name", ["own_arm", "own_arm:Leg", "no_such_module:Arm"])
def test_a_backend_that_is_not_there_is_refused_by_its_name(
    settings: Settings, robot: RobotDescription, name: str
) -> None:
    with pytest.raises(ConfigError, match=f"robot.backend: .*{name}"):
        make_backend(with_backend(settings, name), robot.limits)


@pytest.mark.parametrize(
    ("backend", "message"),
    [
        ({"type": "own_arm:Arm", "port": 1}, r"robot.backend: unknown key 'port'.*; valid keys: type"),
        (
            {"type": "paced_arm:PacedArm", "adress": "a"},
            r"unknown key 'adress' \(did you mean 'address'\?\); valid keys: type, simulator, address",
        ),
        (
            {"type": "paced_arm:PacedArm", "port": 0},
            r"robot.backend.port: .*equal to 1, got 0",
        ),
        ({"port": 0}, r"robot.backend: must be a name, or a mapping with a type"),
        ({"type": "paced_arm:PacedArm", "period": 2}, r"unknown key 'period'"),
        ("nobody", r"there is no 'nobody'; valid names: .*mujoco.*, or package.module:Class"),
    ],
)
def test_options_that_a_backend_does_not_have_are_refused_with_those_that_it_has(
    tmp_path: Path, robot: RobotDescription, backend: object, message: str
) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text(yaml.safe_dump({"robot": {"backend": backend}}), encoding="utf-8")
    with pytest.raises(ConfigError, match=message):
        make_backend(load_settings(file), robot.limits)


def test_options_reach_the_backend_and_survive_the_copy_that_a_running_cobot_goes_by(
    tmp_path: Path, robot: RobotDescription
) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text("robot: {backend: {type: 'paced_arm:PacedArm', port: 7}}\n", encoding="utf-8")
    first = load_settings(file)
    file.write_text(yaml.safe_dump(first.model_dump(mode="json", exclude={"robots"})), encoding="utf-8")
    again = load_settings(file)
    for settings in (first, again):
        arm = make_backend(settings, robot.limits)
        assert isinstance(arm, PacedArm)
        assert (arm.options.port, arm.options.address) == (7, "192.0.2.1")


def test_a_period_that_the_device_cannot_be_driven_with_is_refused(
    tmp_path: Path, robot: RobotDescription
) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text("robot: {backend: 'paced_arm:PacedArm'}\nrt: {period_s: 0.002}\n", encoding="utf-8")
    message = "rt.period_s is 0.002 s; the device can be driven every 0.001, 0.005 s"
    with pytest.raises(ConfigError, match=message):
        make_backend(load_settings(file), robot.limits)


@pytest.mark.parametrize("kind", [Boasts, BoastsLater])
def test_capabilities_of_another_type_are_refused(
    settings: Settings, robot: RobotDescription, kind: type
) -> None:
    chosen = with_backend(settings, f"own_arm:{kind.__name__}")
    with pytest.raises(
        ConfigError, match=rf"{kind.__name__}.capabilities is .*; it must be a Capabilities, because "
    ):
        make_backend(chosen, robot.limits)
    with pytest.raises(ConfigError, match="capabilities is"):
        capabilities_of(kind(settings, robot.limits))


def test_an_older_file_has_its_backend_in_the_section_rt(tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text("rt: {backend: 'own_arm:Arm', cpu: 1}\n", encoding="utf-8")
    settings = load_settings(file)
    assert (settings.robot.backend.type, settings.rt.cpu) == ("own_arm:Arm", 1)


def test_the_shipped_backends_are_loaded_by_their_names_and_are_entry_points_too() -> None:
    pyproject = tomllib.loads((Path(__file__).parents[3] / "pyproject.toml").read_text(encoding="utf-8"))
    assert pyproject["project"]["entry-points"][REGISTRY.group] == REGISTRY.shipped
    for name in REGISTRY.shipped:
        assert isinstance(capabilities_of(backend_class(name)), Capabilities)
        assert name in backend_names()


def test_the_backend_of_another_package_is_found_by_its_entry_point_alone(
    tmp_path: Path, settings: Settings, robot: RobotDescription, monkeypatch: pytest.MonkeyPatch
) -> None:
    metadata = tmp_path / "somebodys_arm-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: somebodys-arm\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(
        f"[{REGISTRY.group}]\nsomebodys = own_arm:Arm\nmujoco = own_arm:Arm\n", encoding="utf-8"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    assert isinstance(make_backend(with_backend(settings, "somebodys"), robot.limits), Arm)
    assert backend_names()["mujoco"] == REGISTRY.shipped["mujoco"], "nobody takes the name of a shipped one"
