"""An rtloop that is paused, under a `cobot run` in real time that notices it as it does as shipped.

Oracle: `faults.Record`, which reads the state block as anybody can.
"""

from __future__ import annotations

import time
from collections.abc import Iterator

import pytest
from arm_activities import TASKS, child, doing, name, require_recovery, robot_health
from cobot_run import Run, answering
from faults import Record, watched
from service_activities import active
from thorough import few

from cobot.config import load_settings
from cobot.robot import description as robots
from cobot.types import JointLimits


@pytest.fixture(scope="module")
def limits() -> JointLimits:
    return robots.load_robot(load_settings()).limits


@pytest.fixture(scope="module")
def hasty(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Run]:
    """One that notices pauses as it does as shipped."""
    with answering(Run(tmp_path_factory.mktemp("hasty"), clock="realtime", patient=False)) as started:
        yield started


@pytest.fixture
def record(hasty: Run, limits: JointLimits) -> Iterator[Record]:
    with watched(name(hasty), limits, 0.001) as made:
        yield made


@pytest.mark.parametrize("pause_s", few([0.2, 2.0]))
@pytest.mark.parametrize("task", TASKS)
def test_an_rtloop_that_is_paused_does_not_harm_the_arm(
    hasty: Run, record: Record, task: str, pause_s: float
) -> None:
    with doing(hasty, task) as done:
        victim = child(hasty, "rtloop", done)
        victim.suspend()
        time.sleep(pause_s)
        victim.resume()
        hasty.until(lambda: "the computer is too slow or too busy" in " ".join(record.reasons))
    require_recovery(hasty, record, task)


@pytest.mark.parametrize("activity", few(["servo", "goal", "sequence", "lua"]))
def test_what_the_service_does_for_others_ends_with_a_pause_of_rtloop(
    hasty: Run, record: Record, activity: str
) -> None:
    with active(hasty, activity) as acting:
        victim = child(hasty, "rtloop", acting)
        victim.suspend()
        time.sleep(0.4)
        victim.resume()
        hasty.until(lambda: "late: the computer is too slow or too busy" in acting.error())
        hasty.until(lambda: robot_health(hasty).get("mode") == "HOLD")
    hasty.go_home()
    assert record.violations() == []
