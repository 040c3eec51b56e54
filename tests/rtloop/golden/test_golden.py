"""The real-time core does what it did: every scenario, cycle by cycle, on the virtual clock.

Oracle: `traces.npz`, recorded from the numpy implementation of the core that preceded the compiled one, with
the planned motions of `inputs.npz`. Commands agree to 1e-9, where that run was not more sensitive to rounding
itself (`golden.ensemble`); modes, counts, answers and reasons agree exactly.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from golden import ensemble, stage
from golden.scenarios import SCENARIOS

from cobot.config import Settings
from cobot.ipc.layout import Intervention
from cobot.robot.description import RobotDescription
from cobot.types import Array

ROWS = ("position", "velocity", "acceleration")


@pytest.fixture(scope="module")
def recorded() -> Iterator[np.lib.npyio.NpzFile]:
    with np.load(stage.TRACES) as file:
        yield file


@pytest.fixture(scope="module")
def inputs() -> dict[str, Array]:
    return stage.load_inputs()


def first_difference(found: Array, wanted: Array, allowed: Array, cycles: int) -> str:
    """Of commands, shape (n, 3, dof), in words; "" if there is none."""
    off = np.abs(found - wanted)
    beyond = ~(off <= allowed[:, :, None])
    if not beyond.any():
        return ""
    at, row, joint = np.argwhere(beyond)[0]
    cycle = min(at * stage.EVERY, cycles - 1)
    return (
        f"cycle {cycle} of {cycles}: commanded {ROWS[row]} of joint {joint + 1} is {found[at, row, joint]!r} "
        f"instead of {wanted[at, row, joint]!r}, off by {off[at, row, joint]:.3g}, allowed: "
        f"{allowed[at, row]:.3g}; the largest difference of all cycles is {np.nanmax(off):.3g}"
    )


def test_every_scenario_is_recorded(recorded: np.lib.npyio.NpzFile) -> None:
    assert ensemble.names(dict.fromkeys(recorded.files)) == list(SCENARIOS)


@pytest.mark.parametrize("name", SCENARIOS)
def test_the_core_does_what_it_did(
    settings: Settings,
    robot: RobotDescription,
    inputs: dict[str, Array],
    recorded: np.lib.npyio.NpzFile,
    name: str,
) -> None:
    found = stage.play(settings, robot, inputs, name)
    wanted = {what: recorded[f"{name}/{what}"] for what in found}
    spread = {what: recorded[f"{name}/{what}_spread"] for what in ("commands", "path_times", "measured")}
    assert str(found["words"]).splitlines() == str(wanted["words"]).splitlines()
    cycles = int(wanted["cycles"])
    assert int(found["cycles"]) == cycles
    other = np.flatnonzero((found["modes"] != wanted["modes"]) & recorded[f"{name}/modes_sure"])
    assert not other.size, (
        f"cycle {other[0] * stage.EVERY} of {cycles}: mode {found['modes'][other[0]]} "
        f"instead of {wanted['modes'][other[0]]}"
    )
    allowed = ensemble.tolerance(spread["commands"], ensemble.ATOL)
    difference = first_difference(found["commands"], wanted["commands"], allowed, cycles)
    assert not difference, difference
    off = np.abs(found["path_times"] - wanted["path_times"])
    late = np.flatnonzero(~(off <= ensemble.tolerance(spread["path_times"], ensemble.ATOL)))
    assert not late.size, f"cycle {late[0] * stage.EVERY}: the path time is off by {off[late[0]]:.3g} s"
    require_measured(found["measured"], wanted["measured"], spread["measured"])
    require_counts(found["counts"], wanted["counts"], recorded[f"{name}/counts_sure"])


def require_measured(found: Array, wanted: Array, spread: Array) -> None:
    """Positions, then efforts and wrench; efforts show a spread first, so all share theirs."""
    dof = (found.shape[1] - 6) // 2
    least = np.array([ensemble.ATOL] * dof + [ensemble.EFFORT_ATOL] * (dof + 6))
    allowed = np.maximum(least, ensemble.tolerance(spread, 0.0)[:, None])
    off = np.abs(found - wanted)
    beyond = np.argwhere(~(off <= allowed))
    if beyond.size:
        row, column = beyond[0]
        raise AssertionError(
            f"measured, row {row} of {len(off)}, column {column} (position, external effort, wrench): off "
            f"by {off[row, column]:.3g}, allowed: {allowed[row, column]:.3g}"
        )


def require_counts(found: np.ndarray, wanted: np.ndarray, sure: np.ndarray) -> None:
    """Those that do not depend on rounding."""
    labels = [*stage.COUNTS, *(kind.name for kind in Intervention)]
    rows = zip(labels, found, wanted, sure, strict=True)
    other = {label: (int(now), int(then)) for label, now, then, certain in rows if certain and now != then}
    assert not other, f"(now, then): {other}"
