"""Waves of a roll-out, with cells that are functions. Oracle: docs/fleet.md, "Roll out"."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from cobot_run import until

from cobot.errors import BusyError, CobotError, ConflictError, InputError, NotFoundError, PermissionDenied
from cobot.fleet import roll_outs
from cobot.fleet.bundle import Bundle, BundleProgram, hash_of, read_bundle
from cobot.fleet.messages import FleetAction, written
from cobot.fleet.roll_outs import MAX_BUNDLES, RollOuts

CONTENT = written(
    Bundle(
        name="welding",
        version="1.4",
        programs=[BundleProgram(id="seam", label="Seam", kind="lua", text="")],
        positions=[],
    )
)
AT_ZERO = b'{"name":"a","joints":[0]}'
ROBOTS = [(f"cell-{number}", "arm") for number in range(6)]


class Cells:
    """Six cells: which have the bundle, and what they were told."""

    def __init__(self) -> None:
        self.told: list[tuple[str, str]] = []
        self.active: set[str] = set()
        self.fails: dict[tuple[str, str], str] = {}
        self.states = dict.fromkeys(ROBOTS, "ready")
        self.code = "input"
        self.raises: Exception | None = None

    def send(self, action: FleetAction, cell: str, robot: str) -> dict[str, Any]:
        if self.raises:
            raise self.raises
        self.told.append((action.kind, cell))
        if problem := self.fails.get((action.kind, cell)):
            return {"code": self.code, "text": problem}
        if action.kind == "activate":
            self.active.add(cell)
        elif action.kind == "roll_back":
            self.active.discard(cell)
        return {"code": "ok", "text": f"{action.kind} done"}


@pytest.fixture
def cells() -> Cells:
    return Cells()


@pytest.fixture
def outs() -> RollOuts:
    made = RollOuts()
    made.add(CONTENT)
    return made


def begin(
    outs: RollOuts, cells: Cells, watch_s: float, wave: int = 2, robots: list[tuple[str, str]] = ROBOTS
) -> str:
    begun = outs.begin(
        hash_of(CONTENT), "ada", "operator", robots, wave, watch_s, cells.send, lambda: cells.states
    )
    return str(begun["id"])


def run(outs: RollOuts, cells: Cells, watch_s: float = 0.0) -> dict[str, Any]:
    name = begin(outs, cells, watch_s)
    until(lambda: outs.get(name)["state"] != "running")
    return outs.get(name)


def order_of(cells: Cells, kind: str) -> list[str]:
    return [cell for each, cell in cells.told if each == kind]


def test_one_cell_is_first_and_the_others_follow_in_waves(outs: RollOuts, cells: Cells) -> None:
    found = run(outs, cells)
    assert [len(wave) for wave in found["waves"]] == [1, 2, 2, 1]
    assert (found["state"], len(found["done"])) == ("done", 6)
    kinds = [kind for kind, _ in cells.told]
    assert kinds == ["stage"] * 6 + ["activate"] * 6, "nothing is activated before all have staged it"
    activated = order_of(cells, "activate")
    assert activated[0] == "cell-0"
    assert [set(activated[1:3]), set(activated[3:5])] == [{"cell-1", "cell-2"}, {"cell-3", "cell-4"}]


def test_a_cell_that_cannot_stage_it_ends_all_before_it_begins(outs: RollOuts, cells: Cells) -> None:
    cells.fails["stage", "cell-5"] = "program seam: not valid JSON"
    found = run(outs, cells)
    assert (found["state"], found["done"]) == ("refused", [])
    assert not order_of(cells, "activate")
    assert any("cell-5/arm: program seam: not valid JSON" in line for line in found["lines"])


def test_a_failure_in_a_wave_is_undone_in_all_earlier_ones(outs: RollOuts, cells: Cells) -> None:
    cells.fails["activate", "cell-3"] = "the arm must be at rest"
    found = run(outs, cells)
    assert found["state"] == "rolled_back"
    assert not cells.active
    assert "cell-5" not in order_of(cells, "activate"), "the last wave is not begun"
    assert set(order_of(cells, "roll_back")) == {"cell-0", "cell-1", "cell-2", "cell-4"}


def test_a_cell_that_may_have_activated_it_is_rolled_back_too(outs: RollOuts, cells: Cells) -> None:
    cells.code = "unavailable"
    cells.fails["activate", "cell-3"] = "the cell has not answered"
    found = run(outs, cells)
    assert (found["state"], found["done"]) == ("rolled_back", [])
    assert "cell-3" in order_of(cells, "roll_back")


def test_a_cell_whose_real_time_process_restarts_is_waited_for(outs: RollOuts, cells: Cells) -> None:
    cells.states["cell-0", "arm"] = "silent"
    name = begin(outs, cells, 0.0)
    until(lambda: order_of(cells, "activate"))
    assert outs.get(name)["state"] == "running"
    cells.states["cell-0", "arm"] = "ready"
    until(lambda: outs.get(name)["state"] == "done")


@pytest.mark.parametrize("state", ["fault", "estop", "silent", "gone"])
def test_a_cell_that_gets_a_fault_while_it_is_watched_ends_it(
    outs: RollOuts, cells: Cells, state: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(roll_outs, "SILENT_S", 0.1)
    cells.states["cell-0", "arm"] = state
    found = run(outs, cells, watch_s=30.0)
    assert (found["state"], order_of(cells, "activate")) == ("rolled_back", ["cell-0"])
    assert f"cell-0/arm is in the state {state}" in found["lines"]


def test_what_cannot_be_rolled_back_is_named(outs: RollOuts, cells: Cells) -> None:
    cells.fails |= {("activate", "cell-1"): "no", ("roll_back", "cell-2"): "does not answer"}
    found = run(outs, cells)
    assert (found["state"], found["done"]) == ("failed", [("cell-2", "arm")])
    assert found["lines"][-1] == "NOT rolled back: cell-2/arm"


def test_an_error_of_the_hub_ends_it_visibly(outs: RollOuts, cells: Cells) -> None:
    cells.raises = RuntimeError("out of memory")
    found = run(outs, cells)
    assert (found["state"], found["lines"][-1]) == (
        "failed",
        "ended because of an error in the hub: out of memory",
    )


def test_it_can_be_cancelled_and_another_one_waits_for_its_end(outs: RollOuts, cells: Cells) -> None:
    name = begin(outs, cells, watch_s=600.0)
    with pytest.raises(BusyError, match=f"the roll-out {name} of welding 1.4 is running"):
        begin(outs, cells, 0.0)
    until(lambda: order_of(cells, "activate"))
    with pytest.raises(
        PermissionDenied, match="started the roll-out with the role operator; your role observer is lower"
    ):
        outs.cancel(name, "observer")
    outs.cancel(name, "operator")
    until(lambda: outs.get(name)["state"] == "rolled_back")
    assert not cells.active
    with pytest.raises(ConflictError, match="has ended: rolled_back"):
        outs.cancel(name, "admin")
    assert run(outs, cells)["state"] == "done"


def test_the_oldest_bundles_are_forgotten(outs: RollOuts, cells: Cells) -> None:
    for number in range(MAX_BUNDLES):
        outs.add(CONTENT.replace(b"1.4", f"2.{number}".encode()))
    with pytest.raises(NotFoundError, match="POST it to /bundles first"):
        begin(outs, cells, 0.0)


@pytest.mark.parametrize(
    ("change", "error"),
    [
        (lambda outs, cells: outs.get("none"), NotFoundError),
        (
            lambda outs, cells: outs.begin(hash_of(CONTENT), "ada", "operator", [], 1, 0.0, cells.send, dict),
            InputError,
        ),
    ],
)
def test_wrong_requests_are_errors(
    outs: RollOuts, cells: Cells, change: Callable[..., Any], error: type[CobotError]
) -> None:
    with pytest.raises(error):
        change(outs, cells)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "the bundle is not valid"),
        (b"[" * 100_000, "the bundle is not valid"),
        (b" " * (8 * 2**20 + 1), "8388609 bytes, allowed: 8388608"),
        (CONTENT.replace(b'"seam"', b'"../seam"'), "programs[0].id"),
        (CONTENT.replace(b'"lua"', b'"python"'), "programs[0].kind: must be 'sequence' or 'lua'"),
        (CONTENT.replace(b'"1.4"', b'"1 4"'), "version"),
        (CONTENT.replace(b'"positions":[]', b'"positions":[{"name":"a","joints":[NaN]}]'), "not valid"),
        (
            CONTENT.replace(b'"positions":[]', b'"positions":[%b,%b]' % (AT_ZERO, AT_ZERO)),
            "the bundle has the position 'a' twice",
        ),
    ],
)  # fmt: skip
def test_what_is_no_bundle_is_an_error(content: bytes, words: str) -> None:
    with pytest.raises(InputError) as caught:
        read_bundle(content)
    assert words in str(caught.value)
