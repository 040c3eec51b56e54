"""Two runs never write the same kept files. Oracle: the second one is a process of its own."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from cobot.config import Settings, load_settings
from cobot.errors import ConflictError
from cobot.launch.supervisor.kept_lock import lock_files, locking_kept_files

HOLD = """
import sys
from pathlib import Path
from cobot.config import load_settings
from cobot.launch.supervisor.kept_lock import locking_kept_files
with locking_kept_files(load_settings(Path(sys.argv[1]))):
    print("held", flush=True)
    sys.stdin.read()
"""


def settings(folder: Path, text: str) -> tuple[Settings, Path]:
    config = folder / f"{len(list(folder.iterdir()))}.yaml"
    config.write_text(text, encoding="utf-8")
    return load_settings(config), config


@pytest.mark.parametrize(
    ("first", "second", "named"),
    [
        ("logs: logs", "logs: logs", "logs"),
        ("{logs: a, kept: kept}", "{logs: b, kept: kept}", "kept"),
        ("{logs: a, kept: kept}", "logs: kept", "kept"),
        ("{logs: a, recording: {folder: mcap}}", "{logs: b, recording: {folder: mcap}}", "mcap"),
        ("logs: logs", "{logs: logs, robots: [{name: other}, {name: iiwa}]}", "logs"),
    ],
)
def test_a_second_run_in_the_same_folder_is_refused_and_the_lock_dies_with_its_process(
    tmp_path: Path, first: str, second: str, named: str
) -> None:
    _, config = settings(tmp_path, first)
    mine, _ = settings(tmp_path, second)
    command = [sys.executable, "-c", HOLD, str(config)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "held\n"
        with pytest.raises(ConflictError) as caught, locking_kept_files(mine):
            pass
        assert str(caught.value).startswith(f"{tmp_path / named}: another cobot (pid {other.pid} on ")
        assert "robot 'iiwa'" in str(caught.value)
        other.kill()
    with locking_kept_files(mine):
        assert all(stat.S_IMODE(path.stat().st_mode) == 0o600 for path in lock_files(mine))


def test_runs_of_other_robots_or_in_other_folders_do_not_disturb_each_other(tmp_path: Path) -> None:
    one, _ = settings(tmp_path, "logs: logs")
    robots, _ = settings(tmp_path, "{logs: logs, robots: [{name: left}, {name: right}]}")
    elsewhere, _ = settings(tmp_path, "logs: elsewhere")
    sets = [lock_files(each) for each in (one, robots, elsewhere)]
    assert len(set.union(*sets)) == sum(map(len, sets))


def test_a_link_in_place_of_the_lock_is_not_followed(tmp_path: Path) -> None:
    mine, _ = settings(tmp_path, "logs: logs")
    (tmp_path / "logs").mkdir()
    (tmp_path / "logs" / "iiwa.lock").symlink_to(tmp_path / "target")
    with pytest.raises(ConflictError, match=r"iiwa\.lock: cannot be locked"), locking_kept_files(mine):
        pass
    assert not os.path.lexists(tmp_path / "target")
