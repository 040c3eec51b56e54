"""`cobot simulate fri`: what it refuses before it begins."""

from __future__ import annotations

import signal
import sys

import pytest

from rtloop.backends.fri.simulator.__main__ import main
from rtloop.backends.simulators.udp_server import UdpServer


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (["--period", "0"], "the send period is 0 ms; FRI allows 1 to 100 ms"),
        (["--multiplier", "0"], "the receive multiplier is 0; it must be 1 or more"),
        (["--client", "nowhere"], "'nowhere' is not HOST:PORT"),
        (["--client", "[::1]:30200"], "client '[::1]' is neither an IPv4 address nor a host name"),
        (["--address", "::1"], "'::1' is not an IPv4 address"),
        (["--port", "99999"], "'99999' is not a whole number from 0 to 65535"),
        (["--port", "-5"], "'-5' is not a whole number from 0 to 65535"),
        (["--control-port", "99999"], "'99999' is not a whole number from 0 to 65535"),
        (["--loss", "2"], "'2' is not a number from 0 to 1"),
        (["--delay", "-1"], "'-1' is not a whole number from 0 to 100"),
        (["--patience", "nan"], "'nan' is not a number from 0 to 3600"),
        (["--priority", "200"], "'200' is not a whole number from 1 to 99"),
        (
            ["--overlay", "torque", "--control-mode", "position"],
            "--overlay torque needs --control-mode joint-impedance, got position",
        ),
        (["--io", "Tool:boolean"], "'Tool:boolean' is not NAME:TYPE:WAY[=VALUE]"),
        (["--io", "A:boolean:output=nan"], "A is boolean: the value must be 0 or 1, got nan"),
        (["--io", "A:boolean:input=7"], "A is boolean: the value must be 0 or 1, got 7"),
        (
            ["--io", "A:digital:output=1e400"],
            "A is digital: the value must be a whole number from 0 to 9007199254740991, got",
        ),
        (["--io", "A:analog:output=inf"], "A: the value is not finite"),
    ],
)
def test_refuses_what_makes_no_sense(
    options: list[str], text: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(signal, "signal", lambda *_: None)
    monkeypatch.setattr(UdpServer, "run", lambda *_: None)
    monkeypatch.setattr(sys, "argv", ["cobot simulate fri", *options])
    try:
        code: object = main()
    except SystemExit as exc:
        code = exc.code
    assert code == 2
    assert text in capsys.readouterr().err
