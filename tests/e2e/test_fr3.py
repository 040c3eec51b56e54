"""The whole REST tour on the simulated FR3, which ships beside the iiwa.

Oracle: where the service says that the arm is afterwards.
"""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import rest_tour
import yaml
from cobot_run import Run, answering
from franka_settings import FR3
from thorough import few


class Fr3Run(Run):
    """The settings of a test, for the other arm."""

    def command(self) -> list[str]:
        settings = yaml.safe_load(self.config.read_text(encoding="utf-8"))
        other = yaml.safe_load(FR3.read_text(encoding="utf-8"))
        settings["robot"] = {**other["robot"], **settings["robot"]}
        settings["web"] = {**other["web"], **settings["web"]}
        self.config.write_text(yaml.safe_dump(settings), encoding="utf-8")
        return super().command()


@pytest.fixture(scope="module")
def fr3(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Run]:
    with answering(Fr3Run(tmp_path_factory.mktemp("fr3"))) as started:
        yield started


@pytest.mark.parametrize("part", few(rest_tour.PARTS))
def test_the_rest_tour(fr3: Run, part: str) -> None:
    rest_tour.tour(fr3, part)
