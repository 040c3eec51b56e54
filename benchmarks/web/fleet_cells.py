"""`python -m benchmarks.web.fleet_cells HUB FIRST NUMBER`: cells that run the fleet's code, without arms."""

from __future__ import annotations

import signal
import sys
import tempfile
import threading
import time
from pathlib import Path

from cobot.config import load_settings
from cobot.fleet.cell import FleetCell

FLEET = "benchmark"


class MovingArm:
    """An arm that always moves, so that every state is published. The reason contains the time of the
    state.
    """

    def read(self) -> dict[str, str]:
        return {"state": "moving", "mode": "TRAJECTORY", "reason": repr(time.time())}

    def close(self) -> None:
        """Do nothing, because there is no shared memory."""


def cell_of(hub: str, name: str, folder: Path) -> FleetCell:
    config = folder / f"{name}.yaml"
    config.write_text(
        f"robot: {{name: {name}}}\nlogs: {folder}/{name}\n"
        f"fleet: {{name: {FLEET}, cell: {name}, connect: ['{hub}']}}\n",
        encoding="utf-8",
    )
    cell = FleetCell(load_settings(config), config, config, "", "")
    for robot in cell.robots.values():
        robot._arm = MovingArm()  # type: ignore[assignment]
        robot.stop = lambda who, command: "the arm is at rest"  # type: ignore[method-assign]
    return cell


def main() -> int:
    hub, first, number = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
    ended = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: ended.set())
    with tempfile.TemporaryDirectory() as folder:
        cells = [cell_of(hub, f"cell-{index}", Path(folder)) for index in range(first, first + number)]
        threads = [threading.Thread(target=cell.run, args=(ended,), daemon=True) for cell in cells]
        for thread in threads:
            thread.start()
        ended.wait()
        for cell in cells:
            cell.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
