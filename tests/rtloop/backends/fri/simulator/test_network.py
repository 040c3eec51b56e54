"""What the simulated network does to packets, and what may be asked of the simulator."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import pytest
from lockstep_fri import made_cabinet

from cobot.config import Settings
from cobot.robot.description import RobotDescription
from rtloop.backends.fri.messages import IoDirection, IoType, IoValue
from rtloop.backends.fri.simulator.control import ControlServer
from rtloop.backends.fri.simulator.network import FriNetwork
from rtloop.backends.fri.simulator.options import CabinetOptions


def passed(network: FriNetwork, count: int) -> list[int]:
    found = []
    for number in range(count):
        found += [int(packet) for packet in network.to_client(str(number).encode())]
    return found


def test_passes_everything_on_when_nothing_is_asked_for() -> None:
    assert passed(FriNetwork(), 100) == list(range(100))


def test_loses_the_share_that_it_is_told_and_the_same_each_time() -> None:
    network = FriNetwork(seed=3, loss=0.2)
    arrived = passed(network, 10_000)
    assert len(arrived) + network.lost == 10_000
    assert network.lost / 10_000 == pytest.approx(0.2, abs=0.02)
    assert arrived == passed(FriNetwork(seed=3, loss=0.2), 10_000)


def test_reorders_without_losing() -> None:
    arrived = passed(FriNetwork(seed=4, reorder=0.1), 1000)
    assert arrived != sorted(arrived)
    assert set(range(999)) <= set(arrived)
    assert len(set(arrived)) == len(arrived)


def test_delays_answers_by_whole_periods() -> None:
    network = FriNetwork(delay=2)
    arrived = []
    for number in range(10):
        assert network.arrived() == []
        network.to_client(b"0")
        arrived.append([int(each) for each in network.from_client(str(number).encode())])
    assert arrived == [[], [], *([each] for each in range(8))]


def test_drops_the_next_ones_only() -> None:
    network = FriNetwork()
    network.drop = 3
    assert passed(network, 10) == [3, 4, 5, 6, 7, 8, 9]


@pytest.fixture
def control(settings: Settings, robot: RobotDescription) -> Iterator[ControlServer]:
    options = CabinetOptions(io=(IoValue("Tool.Open", IoType.BOOLEAN, IoDirection.INPUT),))
    control = ControlServer(0, made_cabinet(settings, robot, options), FriNetwork(), lambda: {"more": 1})
    yield control
    control.close()


def asked(control: ControlServer, **request: Any) -> dict[str, Any]:
    return control.answer(json.dumps(request).encode())


def test_control_says_how_it_is_and_does_what_it_is_told(control: ControlServer) -> None:
    assert asked(control)["state"] == "IDLE"
    assert asked(control, safety_stop=1)["safety"] == "SAFETY_STOP_LEVEL_1"
    assert asked(control, safety_stop=-1)["safety"] == "NORMAL_OPERATION"
    assert asked(control, mode="T1")["mode"] == "T1"
    assert asked(control, io={"Tool.Open": 1.0})["io"] == {"Tool.Open": 1.0}
    assert asked(control, loss=0.5, drop=3)["more"] == 1


@pytest.mark.parametrize(
    ("line", "text"),
    [
        (b"{", "Invalid JSON"),
        (b'{"los": 1}', "unknown key 'los' (did you mean 'loss'?)"),
        (b'{"loss": 2}', "loss: must be less than or equal to 1"),
        (b'{"safety_stop": 3}', "safety_stop: must be less than or equal to 2"),
        (b'{"io": {"Other": 1}}', "'Other' is not registered; valid names: ['Tool.Open']"),
        (b'{"push": [1e300, 0, 0, 0, 0, 0]}', "push[0]: must be less than or equal to 1000"),
        (b'{"push": [0, NaN, 0, 0, 0, 0]}', "push[1]: must be "),
        (b'{"io": {"Tool.Open": NaN}}', "Tool.Open is boolean: the value must be 0 or 1, got nan"),
        (b'{"io": {"Tool.Open": 1e400}}', "Tool.Open is boolean: the value must be 0 or 1, got inf"),
    ],
)
def test_control_refuses_in_words(control: ControlServer, line: bytes, text: str) -> None:
    assert text.lower() in control.answer(line)["error"].lower()
