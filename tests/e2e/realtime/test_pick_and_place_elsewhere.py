"""The example program of the shipped cell with an arm behind each protocol: one changed line.

Oracles: the joints that the simulated controller of the arm reports, in a process of its own, at the moments
at which the fingers are commanded; the bodies that MuJoCo steps (GET /cell).
"""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from cell_run import EXAMPLE, IN_TRAY, RunOfCell
from cobot_run import HELPER_ENVIRONMENT, WAIT_S, Run, answering
from crx_arm import crx_folder
from dds_peers import own_domain
from fanuc_run import ControllerProcess as FanucController
from fanuc_run import RunOverFanuc
from rsi_run import RsiProcess, RunOverRsi, free_udp_port, kr10
from ur_arm import ur_folder
from ur_run import ControllerProcess as UrController
from ur_run import RunOverUr

from cobot.cell import load_cell
from cobot.cell.surroundings import hand_as_tool
from cobot.config import SETTINGS_FILE, load_settings
from cobot.robot.description import load_robot

pytestmark = [pytest.mark.thorough, pytest.mark.timeout(600)]
PICK, PLACE = (0.5, -0.3, 0.225), (0.55, 0.3, 0.235)
NEAR_M = 6e-3
"""The controllers lag, and the arm ends 4 mm deeper in the tray than the cube where it touches."""
LOOK_S = 0.02
WRIST_OVER = (-30.0, -5.0, -10.0, 180.0, 80.0, -30.0)
"""A home of the CRX from which joint 6 turns the cube to the tray within its range, in degrees."""


class InCell(RunOfCell):
    """With the cell of the example, around an arm that a simulator has."""

    cell = EXAMPLE

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super(RunOfCell, self).__init__(*arguments, **options)


class UrInCell(InCell, RunOverUr): ...


class FanucInCell(InCell, RunOverFanuc): ...


class RsiInCell(InCell, RunOverRsi): ...


class RosInCell(InCell, Run):
    def start(self) -> subprocess.Popen[str]:
        settings = yaml.safe_load(self.config.read_text())
        settings["robot"]["backend"] = {"type": "ros2_control", "simulator": True, "connect_s": 20.0}
        settings["rt"] |= {"frozen_after_s": 0.5, "tracking_error_rad": 0.5}
        self.config.write_text(yaml.safe_dump(settings))
        return super().start()


Joints = Callable[[], list[float]]


@contextmanager
def over_ur(folder: Path) -> Iterator[tuple[InCell, Joints]]:
    arm = ur_folder(folder) / SETTINGS_FILE
    with UrController(arm) as controller:
        made = UrInCell(folder, arm, controller.address, simulator=True)
        with answering(made):
            yield made, lambda: controller.ask()["measured"]


@contextmanager
def over_fanuc(folder: Path) -> Iterator[tuple[InCell, Joints]]:
    arm = crx_folder(folder, home=WRIST_OVER) / SETTINGS_FILE
    with FanucController(arm) as controller:
        made = FanucInCell(folder, arm, controller.stream_port, controller.rmi_port, simulator=True)
        with answering(made):
            yield made, lambda: controller.ask()["measured"]


@contextmanager
def over_rsi(folder: Path) -> Iterator[tuple[InCell, Joints]]:
    port = free_udp_port()
    made = kr10(folder, port, address="127.0.0.1", simulator=True)
    settings = yaml.safe_load((made / SETTINGS_FILE).read_text())
    del settings["robot"]["gripper"]
    (made / SETTINGS_FILE).write_text(yaml.safe_dump(settings))
    with RsiProcess(made, port) as controller, answering(RsiInCell(made)) as run:
        yield run, lambda: controller.ask()["measured"]


@contextmanager
def over_ros2_control(folder: Path) -> Iterator[tuple[InCell, Joints]]:
    with ExitStack() as stack:
        domain = stack.enter_context(own_domain())
        command = [sys.executable, "-m", "cobot", "simulate", "ros2_control", "--domain", str(domain)]
        simulator = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=HELPER_ENVIRONMENT)
        stack.enter_context(simulator)
        stack.callback(simulator.terminate)
        assert simulator.stdout is not None
        assert f"domain {domain}" in simulator.stdout.readline()
        run = stack.enter_context(answering(RosInCell(folder, clock="realtime", ros_domain=domain)))
        yield run, run.joints


class Watch:
    """Where the flange's tool was, by the controller, whenever the fingers were commanded another width."""

    def __init__(self, run: InCell, joints: Joints) -> None:
        settings = load_settings(run.made / SETTINGS_FILE if isinstance(run, RsiInCell) else run.config)
        self._model = load_robot(settings).model
        hand = load_cell(EXAMPLE).hand
        assert hand is not None
        self._model.carry(hand_as_tool(hand))
        self._run, self._joints, self._ended = run, joints, False
        self.seen: list[tuple[float, list[float]]] = []

    def __enter__(self) -> Watch:
        self._width = self._commanded()
        self._thread = threading.Thread(target=self._look)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended = True
        self._thread.join()

    def _commanded(self) -> float:
        points = self._run.ask("GET", "/robot/io")["points"]
        return float(next(each["value"] for each in points if each["name"] == "hand.width"))

    def _look(self) -> None:
        while not self._ended:
            width = self._commanded()
            if width != self._width:
                self._width = width
                place = self._model.forward(np.array(self._joints())).position
                self.seen.append((width, place.tolist()))
            time.sleep(LOOK_S)


@pytest.mark.parametrize("over", [over_ur, over_fanuc, over_rsi, over_ros2_control])
def test_the_example_picks_and_places(over: Any, tmp_path: Path) -> None:
    with over(tmp_path) as (run, joints):
        (robot,) = run.ask("GET", "/robots")
        assert "simulated next to it" in robot["device"]["status"]["text"]
        if robot["device"]["unacknowledged"]:
            run.ask("POST", "/robot/acknowledge", json={"payload_checked": True})
        run.until(lambda: run.ask("GET", "/robot/gripper")["connected"])
        command = [sys.executable, "-m", "cobot", "run", str(EXAMPLE / "pick_and_place.json")]
        with Watch(run, joints) as watch:
            ended = subprocess.run(
                command,
                env={**os.environ, "COBOT_URL": run.url},
                capture_output=True,
                text=True,
                timeout=WAIT_S,
                check=False,
            )
        assert ended.returncode == 0, ended.stdout + ended.stderr
        *_, (closed, pick), (opened, place) = watch.seen
        assert closed < 0.05 < opened
        np.testing.assert_allclose(pick, PICK, atol=NEAR_M)
        np.testing.assert_allclose(place, PLACE, atol=NEAR_M)
        assert run.cube() == IN_TRAY
        assert run.count() == 1
