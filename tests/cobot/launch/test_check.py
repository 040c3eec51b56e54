"""`cobot check` and the command line. Oracle: POSIX exit codes, and files broken by hand."""

from __future__ import annotations

import re
import sys
from importlib.metadata import version
from pathlib import Path

import pytest
from independent_models import LIMITS, MJCF, SRDF

from cobot.config import Settings
from cobot.launch import check
from cobot.launch.cli import main
from cobot.launch.hardware import check_hardware
from cobot.robot.device import LESS

DOCS = Path(__file__).parents[3] / "docs"
IN_THE_FLOOR = (0.0, 1.9, 0.0, -0.2, 0.0, 0.0, 0.0)


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the shipped settings have their logs and recordings."""
    monkeypatch.setenv("HOME", str(tmp_path))


@pytest.fixture
def device(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """The process that looks at the backend takes half a second: it is not asked where it is about others."""
    if "backend" not in request.getfixturevalue("message"):
        monkeypatch.setattr(check, "_backend", lambda settings, config: "not asked")


def config(folder: Path, text: str) -> list[str]:
    file = folder / "mine.yaml"
    file.write_text(text, encoding="utf-8")
    return ["check", "--config", str(file)]


def with_home_at(folder: Path, name: str, joints: tuple[float, ...]) -> list[str]:
    """The shipped settings with another position of this name."""
    values = "".join(f'<joint name="joint{i + 1}" value="{value}"/>' for i, value in enumerate(joints))
    state = re.compile(rf'(<group_state name="{name}"[^>]*>).*?(</group_state>)', re.DOTALL)
    text = state.sub(rf"\1{values}\2", SRDF.read_text(encoding="utf-8"))
    (folder / "mine.srdf").write_text(text, encoding="utf-8")
    return config(folder, "robot: {srdf: mine.srdf}\n")


def test_the_shipped_configuration_is_good(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check"]) == 0
    output = capsys.readouterr()
    lines = output.out.splitlines()
    assert all(line.startswith("ok ") for line in lines)
    items = [line.removeprefix("ok").strip() for line in lines]
    assert [item.partition(":")[0] for item in items] == [
        *("endpoints", "address", "access", "fleet", "logs", "recordings", "recording", "core", "robot"),
        *("visuals", "efforts", "backend"),
        *("position home", "position work", "position transport"),
    ]
    assert "endpoints: 0 changed in" in lines[0]
    assert "address: 127.0.0.1 port 8007" in lines[1]
    assert "robot: 7 joints" in lines[8]
    assert re.search(r"position home: .* TCP at x 0\.400 y -?0\.000 z 0\.654 m in base_link", lines[12])
    assert output.err == ""


@pytest.mark.usefixtures("device")
@pytest.mark.parametrize(
    ("joints", "message"),
    [
        (
            (0.0, 2.2, 0.0, -1.57, 0.0, 1.57, 0.0),
            "joint2 is 2.2 rad, allowed: -2.1 to 2.1 rad",
        ),
        (IN_THE_FLOOR, "touches"),
        ((0.0, 2.1, 0.0, -2.1, 0.0, 0.0, 0.0), "touches"),
    ],
)
def test_a_named_position_that_cannot_be_is_reported_with_the_others_still_checked(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    joints: tuple[float, ...],
    message: str,
) -> None:
    assert main(with_home_at(tmp_path, "work", joints)) == 1
    lines = capsys.readouterr().out.splitlines()
    failed = [line for line in lines if line.startswith("FAILED")]
    assert len(failed) == 1
    assert failed[0].startswith("FAILED  position work: ")
    assert message in failed[0]
    assert sum(line.startswith("ok      position") for line in lines) == 2


def test_a_named_position_without_a_joint_is_reported_with_file_position_and_joint(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(with_home_at(tmp_path, "transport", (0.0,) * 6)) == 1
    output = capsys.readouterr().out
    assert re.search(r"FAILED  robot: .*mine\.srdf: position 'transport': joint7 missing", output)


@pytest.mark.usefixtures("device")
@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("robot: {model: no.xml}", r"FAILED  robot: .*no\.xml: no such file"),
        ("robot: {srdf: no.srdf}", r"FAILED  robot: .*no\.srdf: no such file"),
        ("web: {joint_limits: no.yaml}", r"FAILED  robot: .*no\.yaml: no such file"),
        ("web: {endpoints: no.yaml}", r"FAILED  endpoints: .*no\.yaml: no such file"),
        (
            "robot: {start_position: hom}",
            r"FAILED  robot: robot\.start_position: 'hom' is not in .*; valid names: home, work, transport",
        ),
        ("robot: {tcp: gripper}", r"FAILED  robot: .*robot\.tcp: the model has no site or body 'gripper'"),
        (
            "planning: {default_frame: moon}",
            r"FAILED  robot: planning\.default_frame: there is no frame 'moon'; valid names: base_link",
        ),
        (
            "rt: {backend: no.such:Arm}",
            r"FAILED  backend: robot\.backend: cannot load 'no\.such:Arm': .*'no'",
        ),
        (
            "rt: {backend: 'json:loads'}",
            r"FAILED  backend: robot\.backend: cannot load 'json:loads': TypeError",
        ),
        ("robot: {tcp: world}", r"FAILED  robot: .*robot\.tcp: 'world' is not moved by joint1, joint2"),
        ("robot: {model: /tmp}", r"FAILED  robot: robot\.model: /tmp: is not a file"),
        (
            "robot: {name: a}\nlogs: logs",
            r"FAILED  logs: .*logs/a\.log: cannot be written to: Is",
        ),
        ("rt: {cpu: 4096}", r"FAILED  core: rt\.cpu: there is no core 4096; valid cores: \d"),
        ("web: {host: host.invalid}", r"FAILED  address: web\.host: cannot listen on 'host\.invalid'"),
        ("web: {host: 192.0.2.1}", r"FAILED  address: web\.host: cannot listen on '192\.0\.2\.1'"),
        ("logs: mine.yaml/logs", r"FAILED  logs: .*mine\.yaml/logs: cannot be written to: Not a directory"),
        ("sequences: {recordings: mine.yaml}", r"FAILED  recordings: .*mine\.yaml: cannot be written to"),
        ("robot: {group: hand}", r"FAILED  robot: .*has no group 'hand'; valid names: iiwa_arm"),
    ],
)
def test_what_the_settings_name_and_is_not_there_is_reported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, message: str
) -> None:
    (tmp_path / "logs" / "a.log").mkdir(parents=True)
    assert main(config(tmp_path, text)) == 1
    output = capsys.readouterr().out
    assert re.search(message, output), output


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "robot: {modle: x.xml}",
            r"mine\.yaml: robot: unknown key 'modle' \(did you mean 'model'\?\); valid keys: name, model,",
        ),
        (
            "wbe: {}",
            r"mine\.yaml: unknown key 'wbe' \(did you mean 'web'\?\); valid keys: robot, rt, streaming",
        ),
        ("rt: {period_s: fast}", r"mine\.yaml: rt\.period_s: .*got 'fast'"),
        ("rt: {period_s: 1.0}", r"mine\.yaml: rt\.period_s: .*0\.01.*got 1\.0"),
        ("rt: {clock: slow}", r"mine\.yaml: rt\.clock: .*'realtime' or 'fast', got 'slow'"),
        ("[1, 2]", r"mine\.yaml: must contain a mapping, got list"),
        ("robot: {name: a\nb", r"mine\.yaml: not valid YAML"),
    ],
)
def test_settings_that_cannot_be_read_are_one_line_on_stderr(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, message: str
) -> None:
    assert main(config(tmp_path, text)) == 1
    output = capsys.readouterr()
    assert output.out == ""
    assert len(output.err.splitlines()) == 1
    assert re.match(rf"cobot: .*{message}", output.err), output.err


def test_a_settings_file_that_is_not_there_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", "--config", str(tmp_path / "nowhere.yaml")]) == 1
    assert capsys.readouterr().err == f"cobot: {tmp_path / 'nowhere.yaml'}: no such file\n"


def test_files_beside_the_settings_are_found_from_there(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for file in (MJCF, SRDF, LIMITS):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    text = f"robot: {{model: {MJCF.name}, srdf: {SRDF.name}}}\nweb: {{joint_limits: {LIMITS.name}}}\n"
    assert main(config(tmp_path, text)) == 0
    assert str(tmp_path / MJCF.name) in capsys.readouterr().out


def test_each_of_several_robots_is_checked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = "robots: [{name: a}, {name: b, start_position: nowhere}, {name: c, backend: 'no.such:Arm'}]"
    assert main(config(tmp_path, text)) == 1
    lines = capsys.readouterr().out.splitlines()
    assert any(line.startswith("ok      a: backend: mujoco: simulation; ") for line in lines)
    assert sum(line.startswith("ok      a: position ") for line in lines) == 3
    failed = [line for line in lines if line.startswith("FAILED")]
    assert len(failed) == 2
    assert failed[0].startswith("FAILED  b: robot: robot.start_position: 'nowhere' is not in")
    assert failed[1].startswith("FAILED  c: backend: robot.backend: cannot load 'no.such:Arm'")


def test_nothing_is_made_not_even_a_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What root had made, a service of another user could not write to."""
    state = tmp_path / "state"
    text = f"logs: {state}/logs\nkept: {state}/kept\nrecording: {{folder: {state}/mcap}}\n"
    text += f"sequences: {{recordings: {state}/recordings, programs: {state}/programs}}\n"
    assert main(config(tmp_path, text)) == 0, capsys.readouterr().out
    assert [each.name for each in tmp_path.iterdir()] == ["mine.yaml"]


def test_help_names_both_commands_and_the_page_to_open(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["--help"])
    assert ended.value.code == 0
    output = capsys.readouterr().out
    for words in ("cobot run", "cobot check", "open http://localhost:8007 and", "--version"):
        assert words in output


@pytest.mark.parametrize("command", ["run", "check"])
def test_each_command_has_its_own_help(capsys: pytest.CaptureFixture[str], command: str) -> None:
    with pytest.raises(SystemExit) as ended:
        main([command, "--help"])
    assert ended.value.code == 0
    assert "--config FILE" in capsys.readouterr().out


def test_version_is_that_of_the_installed_package(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["--version"])
    assert ended.value.code == 0
    assert capsys.readouterr().out == f"cobot {version('cobot')}\n"


def test_no_command_is_wrong_usage_and_shows_the_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 2
    assert "cobot run" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["fly"], "invalid choice: 'fly'"),
        (["check", "--speed", "1"], "unrecognized arguments: --speed 1"),
        (["run", "--port", "eighty"], "'eighty' is not a port: give a number from 0 to 65535"),
        (["run", "--port", "65536"], "'65536' is not a port"),
        (["run", "--port", "-1"], "'-1' is not a port"),
        (["run", "--clock", "slow"], "invalid choice: 'slow'"),
    ],
)
def test_wrong_usage_ends_with_status_2_and_the_reason(
    capsys: pytest.CaptureFixture[str], arguments: list[str], message: str
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 2
    assert message in capsys.readouterr().err


def test_the_list_for_hardware_tells_what_it_knows_and_what_is_to_do(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*config(tmp_path, f"robot: {{name: check-{tmp_path.name[:20]}}}\n"), "--hardware"]) == 1
    said = capsys.readouterr().out
    assert "FAILED  hardware backend: mujoco: simulation" in said
    table = (DOCS / "safety.md").read_text(encoding="utf-8").split("| Item | What to do |\n|---|---|\n")[1]
    listed = {line.split(" | ")[0].removeprefix("| ") for line in table.split("\n\n")[0].splitlines()}
    assert len(listed) > 10
    assert set(re.findall(r"^(?:TO DO|FAILED|ok) +hardware (.+?): ", said, re.MULTILINE)) == listed
    for item in listed - {"backend"}:
        assert f"TO DO   hardware {item}: " in said


def test_limits_of_the_device_that_are_smaller_are_in_the_list(
    settings: Settings, capsys: pytest.CaptureFixture[str]
) -> None:
    found = f"mine: hardware; {LESS}: max_velocity of joint1 is 0.5, not 1.4"
    check_hardware(settings, [check.Checked("backend", True, found)], sys.stdout)
    said = capsys.readouterr().out
    assert (
        f"ok      hardware limits: {LESS}; the device's limits are used: max_velocity of joint1 is 0.5, "
        "not 1.4" in said
    )


def test_a_real_arm_has_no_simulated_hand(settings: Settings, capsys: pytest.CaptureFixture[str]) -> None:
    chosen = {"type": "ur", "options": {"address": "192.168.1.9", "simulator": True}}
    backend = settings.robot.backend.model_copy(update=chosen)
    robot = settings.robot.model_copy(update={"backend": backend})
    found = [check.Checked("backend", True, "ur: hardware; every 2, 4, 8 ms")]
    items = check_hardware(settings.model_copy(update={"robot": robot}), found, sys.stdout)
    assert [each.good for each in items if each.item == "backend"] == [False]
    assert "FAILED  hardware backend: robot.backend.simulator is true" in capsys.readouterr().out
