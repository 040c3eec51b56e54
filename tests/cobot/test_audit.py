"""The audit: nothing that somebody has done is lost in silence, and nobody waits for its disk.

Oracle: the files themselves, read by json.
"""

from __future__ import annotations

import json
import os
import stat
import threading
import time
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from cobot import audit
from cobot.audit import Audit, Trail, record_from_cli, trail
from cobot.config import Settings
from cobot.logs.files import aside


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "arm.audit.jsonl"


@pytest.fixture
def kept(path: Path) -> Iterator[Audit]:
    made = Audit(path)
    yield made
    made.close()


def entries(path: Path) -> list[dict[str, object]]:
    return [json.loads(line) for line in path.read_text(encoding="ascii").splitlines()]


def test_an_entry_says_who_from_where_what_outcome_and_when(kept: Audit, path: Path) -> None:
    before = datetime.now(UTC)
    kept.record("ada", "10.0.0.2:5000", "POST /stop", "200", request="r-1", stopped=["motion 3"], seconds=0.5)
    kept.close()
    (entry,) = entries(path)
    moment = datetime.fromisoformat(str(entry.pop("time")))
    assert abs(moment - before) < timedelta(seconds=60)
    assert moment.utcoffset() == timedelta(0)
    assert entry == {
        "who": "ada",
        "from": "10.0.0.2:5000",
        "what": "POST /stop",
        "outcome": "200",
        "request": "r-1",
        "details": {"stopped": ["motion 3"], "seconds": 0.5},
    }
    assert stat.S_IMODE(path.stat().st_mode) == 0o600


def test_nothing_in_an_entry_can_forge_another_or_reach_a_terminal(kept: Audit, path: Path) -> None:
    text = 'x"}\n{"who": "forged"}\x1b[2J\u2028\u202e'
    kept.record(text, text, text * 1000, text, request=text, more=text, several=[text], other={text: text})
    kept.close()
    (entry,) = entries(path)
    assert len(json.dumps(entry)) < 5000
    for value in (entry["who"], entry["what"], *entry["details"].values()):  # type: ignore[attr-defined]
        assert all(each.isprintable() for each in (value if isinstance(value, list) else [value]))


def test_the_newest_come_first_and_since_ends_them(kept: Audit) -> None:
    for n in range(990):
        kept.record("ada", "::1:1", f"thing {n}")
        if n == 499:
            time.sleep(0.005)
            middle = datetime.now(UTC)
            time.sleep(0.005)
    newest = kept.newest(3)
    assert [each["what"] for each in newest] == ["thing 989", "thing 988", "thing 987"]
    assert len(kept.newest(10_000, middle)) == 490
    assert len(kept.newest(10_000)) == 990
    assert kept.newest(5, datetime.now(UTC) + timedelta(days=1)) == []


def test_the_files_are_bounded_in_size_and_number_and_read_as_one(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(audit, "MAX_BYTES", 10_000)
    monkeypatch.setattr(audit, "OLDER_FILES", 3)
    monkeypatch.setattr(audit, "BURST", 10_000)
    kept = Audit(path)
    for n in range(2000):
        kept.record("ada", "::1:1", f"thing {n}", kind="thing")
    numbers = [int(str(each["what"]).split()[1]) for each in kept.newest(10_000)]
    kept.close()
    assert numbers == list(range(1999, 1999 - len(numbers), -1))
    assert 3 * 9000 / 130 < len(numbers) < 4 * 10_000 / 80
    assert sorted(path.parent.iterdir()) == sorted(aside(path, 3))
    for each in aside(path, 3):
        assert each.stat().st_size <= 10_000
        assert stat.S_IMODE(each.stat().st_mode) == 0o600


def test_what_is_repeated_becomes_one_entry_that_says_how_often(kept: Audit, path: Path) -> None:
    for n in range(500):
        kept.record("ada", f"10.0.0.2:{n}", "POST /stop", "200", request=f"r-{n}")
    kept.record("ada", "10.0.0.2:9", "POST /robot/reset", "200")
    kept.record("bob", "10.0.0.3:9", "POST /stop", "200")
    kept.close()
    found = entries(path)
    stops = [each for each in found if (each["who"], each["what"]) == ("ada", "POST /stop")]
    assert sum(int(str(each.get("repeated", 1))) for each in stops) == 500
    assert len(stops) < 50
    assert len([each for each in found if each["what"] == "POST /robot/reset"]) == 1
    assert len([each for each in found if each["who"] == "bob"]) == 1


def test_while_the_disk_takes_nothing_entries_wait_and_nobody_else(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(audit, "CAPACITY", 100)
    monkeypatch.setattr(audit, "RETRY_S", 0.01)
    path.mkdir()  # no file can be opened there
    kept = Audit(path)
    begun_s = time.monotonic()
    for n in range(300):
        kept.record("ada", "::1:1", f"thing {n}")
    assert time.monotonic() - begun_s < 5.0
    assert kept.dropped == 200
    deadline_s = time.monotonic() + 10.0
    while not kept.problem and time.monotonic() < deadline_s:
        time.sleep(0.01)
    assert "cannot be written: Is a directory" in kept.problem
    path.rmdir()
    while kept.problem and time.monotonic() < deadline_s:
        time.sleep(0.01)
    kept.record("ada", "::1:1", "after")
    kept.close()
    whats = [each["what"] for each in entries(path)]
    assert [what for what in whats if what != "audit"] == [f"thing {n}" for n in range(100)] + ["after"]
    lost = [str(each["outcome"]) for each in entries(path) if each["what"] == "audit"]
    assert sum(int(outcome.removesuffix(" entries were lost")) for outcome in lost) == 200


def test_a_broken_disk_does_not_keep_the_service_from_its_end() -> None:
    kept = Audit(Path("/dev/null/audit"))
    kept.record("ada", "::1:1", "thing")
    begun_s = time.monotonic()
    kept.close()
    assert time.monotonic() - begun_s < 5.0
    assert kept.dropped == 1


def test_notes_belong_to_the_request_of_their_task(kept: Audit, path: Path) -> None:
    audit.note("nobody asked for this")
    audit.add_details(x=1)
    audit.leave_out()
    on = Trail(kept, lambda: "ada", "::1:1", "r-1")
    token = trail.set(on)
    audit.note("session opened", session=3)
    audit.add_details(motion=7)
    trail.reset(token)
    kept.close()
    (entry,) = entries(path)
    assert (entry["who"], entry["what"], entry["request"]) == ("ada", "session opened", "r-1")
    assert on.details == {"motion": 7}


def test_commands_add_their_entries_while_the_service_writes_its_own(
    settings: Settings, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    settings = settings.model_copy(update={"logs": tmp_path / "logs"})
    record_from_cli(settings, "token create ada", role="operator")
    kept = Audit(settings.audit_file)
    commands = [
        threading.Thread(target=record_from_cli, args=(settings, f"command {n}"), kwargs={"outcome": "done"})
        for n in range(10)
    ]
    for n, command in enumerate(commands):
        command.start()
        kept.record("ada", "::1:1", f"request {n}")
    for command in commands:
        command.join()
    kept.close()
    found = entries(settings.audit_file)
    assert found[0]["from"] == "cli"
    assert found[0]["details"] == {"role": "operator"}
    wanted = {f"{kind} {n}" for kind in ("command", "request") for n in range(10)}
    assert {each["what"] for each in found[1:]} == wanted
    assert stat.S_IMODE(settings.audit_file.stat().st_mode) == 0o600
    assert found[0]["who"] in ("root", os.environ.get("USER"), str(os.getuid()))
    (tmp_path / "logs").rename(tmp_path / "gone")
    (tmp_path / "logs").write_text("no folder", encoding="utf-8")
    record_from_cli(settings, "command")
    assert "cannot be written" in capsys.readouterr().err
