"""The command line as it is asked for. Oracles: the parser's own commands; docs/cli.md on COBOT_URL."""

from __future__ import annotations

import re

import pytest

from cobot.addresses import DEFAULT_URL
from cobot.commands.options import url_of
from cobot.launch.cli import main
from cobot.launch.parser import DESCRIPTION, MODULES, make_parser

OF_A_SERVICE = (
    "state",
    "move home",
    "send FILE",
    "jobs",
    "watch",
    "run FILE",
    "lua FILE",
    "mcp",
    "record list",
    "replay FILE",
)


@pytest.mark.parametrize("command", MODULES)
def test_options_of_a_command_may_come_first(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main([command, "--help"])
    assert ended.value.code == 0
    assert f"usage: cobot {command} [-h] " in capsys.readouterr().out
    with pytest.raises(SystemExit):
        main([command, "--no-such-option"])
    assert f"usage: cobot {command} [-h] " in capsys.readouterr().err


@pytest.mark.parametrize("words", OF_A_SERVICE)
def test_each_command_for_a_service_finds_it_by_option_environment_or_default(
    words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def found(*more: str) -> str:
        return url_of(make_parser().parse_args([*words.split(), *more]))

    monkeypatch.delenv("COBOT_URL", raising=False)
    assert found() == DEFAULT_URL
    monkeypatch.setenv("COBOT_URL", "http://robot:9000")
    assert found() == "http://robot:9000"
    assert found("--url", "http://other:1") == "http://other:1"


def test_a_stop_goes_by_shared_memory_whatever_the_environment_says(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COBOT_URL", "http://robot:9000")
    assert make_parser().parse_args(["stop"]).url is None


def test_the_help_says_what_each_command_is_for() -> None:
    listed = set(re.findall(r"[a-z-]+", DESCRIPTION))
    commands = re.findall(r"^    ([a-z-]+)(?: |$)", make_parser().format_help(), re.M)
    assert len(commands) > 15
    assert [name for name in commands if name not in listed] == []
