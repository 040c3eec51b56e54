"""`cobot run` whose arm is a KR over RSI: `cobot new-robot` makes the arm of examples/kuka/kr10.urdf, and a
simulated controller in another process drives it."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import yaml
from cobot_run import RunOfFolder
from folders import ROOT
from fri_run import CabinetProcess, free_udp_port

from cobot.launch.cli import main

KR10 = ROOT / "examples" / "kuka" / "kr10.urdf"
HOME = [0.0, -1.5708, 1.5708, 0.0, 0.5, 0.0]
WORK = [0.2, -1.3, 1.6, 0.1, 1.0, 0.3]
PERIOD_MS = 12
PATIENCE_S = 2.0
"""The controller waits so long for a late answer: a client that rejects its telegrams answers none."""
OUTPUTS = {"close": 1, "open": 2}
INPUTS = {"closed": 1}


def kr10(folder: Path, port: int, period_ms: int = PERIOD_MS, **options: Any) -> Path:
    """The folder of the arm, with two positions and this backend."""
    made = folder / "kr10"
    assert main(["new-robot", str(KR10), "--output", str(made)]) == 0
    srdf = ET.parse(made / "robot.srdf")
    root = srdf.getroot()
    for state in root.findall("group_state"):
        root.remove(state)
    for name, joints in (("home", HOME), ("work", WORK)):
        state = ET.SubElement(root, "group_state", name=name, group="arm")
        for number, value in enumerate(joints, start=1):
            ET.SubElement(state, "joint", name=f"joint_a{number}", value=str(value))
    srdf.write(made / "robot.srdf")
    file = made / "cobot-setting.yaml"
    settings = yaml.safe_load(file.read_text())
    backend = {"listen": "127.0.0.1", "port": port, "max_correction": 350.0, "silence_s": 3.0}
    settings["robot"]["backend"] = {"type": "rsi", **backend, "inputs": INPUTS, "outputs": OUTPUTS, **options}
    settings["robot"]["gripper"] = {
        "type": "digital",
        "close_output": "close",
        "open_output": "open",
        "closed_input": "closed",
    }
    settings["rt"] = {"period_s": period_ms * 1e-3}
    file.write_text(yaml.safe_dump(settings))
    return made


class RsiProcess(CabinetProcess):
    """`cobot simulate rsi` for a client on this computer."""

    device = "rsi"

    def __init__(self, made: Path, port: int, *options: str, **more: Any) -> None:
        config = ("--config", str(made / "cobot-setting.yaml"))
        super().__init__(*config, *options, period_ms=None, port=port, **{"patience_s": PATIENCE_S, **more})


class RunOverRsi(RunOfFolder):
    """The service for that folder, in real time."""

    def start(self) -> Any:
        settings = yaml.safe_load(self.config.read_text())
        settings["rt"]["clock"] = "realtime"
        settings["robot"].pop("backend", None)
        self.config.write_text(yaml.safe_dump(settings))
        return super().start()


__all__ = ["RsiProcess", "RunOverRsi", "free_udp_port", "kr10"]
