"""A file that is put aside when it has grown."""

from __future__ import annotations

import errno
import os
import resource
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from cobot.logs.files import RotatingFile, aside


def test_it_is_put_aside_and_the_oldest_goes(tmp_path: Path) -> None:
    path = tmp_path / "a.log"
    file = RotatingFile(path, 100, 2)
    for n in range(100):
        file.append(f"{n:09}\n".encode())
    assert sorted(tmp_path.iterdir()) == sorted(aside(path, 2))
    text = "".join(each.read_text() for each in reversed(aside(path, 2)))
    assert text.split() == [f"{n:09}" for n in range(70, 100)]
    file.close()


def test_it_goes_on_in_a_new_file_when_somebody_has_taken_it_away(tmp_path: Path) -> None:
    path = tmp_path / "a.log"
    file = RotatingFile(path, 1000, 1)
    file.append(b"one\n")
    path.rename(tmp_path / "taken")
    file.append(b"two\n")
    path.unlink()
    file.append(b"three\n")
    assert path.read_text() == "three\n"
    file.close()


def test_a_private_file_is_its_owners_alone_and_no_link(tmp_path: Path) -> None:
    path = tmp_path / "a.jsonl"
    path.write_text("")
    path.chmod(0o666)
    file = RotatingFile(path, 10, 1, strict=True)
    for _ in range(2):
        file.append(b"12345678\n")
    for each in aside(path, 1):
        assert stat.S_IMODE(each.stat().st_mode) == 0o600
    file.close()
    link = tmp_path / "link"
    link.symlink_to(tmp_path / "target")
    with pytest.raises(OSError, match="symbolic"):
        RotatingFile(link, 10, 1, strict=True).append(b"x")
    assert not (tmp_path / "target").exists()
    with pytest.raises(OSError, match="not a regular file"):
        RotatingFile(Path("/dev/null"), 10, 1, strict=True).append(b"x")
    assert stat.S_IMODE(os.stat("/dev/null").st_mode) == 0o666


def test_logs_and_the_older_ones_are_their_owner_s_alone(tmp_path: Path) -> None:
    path = tmp_path / "made" / "a.log"
    file = RotatingFile(path, 10, 2)
    file.append(b"x\n")
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert stat.S_IMODE(path.parent.stat().st_mode) == 0o700
    file.close()
    for each in (path, older := aside(path, 2)[1]):
        each.write_text("of a version before")
        each.chmod(0o644)
    RotatingFile(path, 1000, 2).open()
    assert [stat.S_IMODE(each.stat().st_mode) for each in (path, older)] == [0o600, 0o600]


def test_a_full_disk_is_an_error_each_time() -> None:
    file = RotatingFile(Path("/dev/full"), 1000, 1)
    for _ in range(2):
        with pytest.raises(OSError) as caught:  # noqa: PT011  the number says which
            file.append(b"x\n")
        assert caught.value.errno == errno.ENOSPC
    file.close()


def test_a_line_that_was_half_written_is_ended_by_the_next(tmp_path: Path) -> None:
    """A limit on the size of files ends in the midst of a write, as a disk does."""
    path = tmp_path / "a.log"
    code = f"""
import resource, signal
from pathlib import Path
from cobot.logs.files import RotatingFile
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (10, {resource.getrlimit(resource.RLIMIT_FSIZE)[1]}))
file = RotatingFile(Path({str(path)!r}), 1000, 1)
file.append(b"whole\\n")
try:
    file.append(b"not whole\\n")
except OSError:
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, {resource.getrlimit(resource.RLIMIT_FSIZE)[1]}))
    file.append(b"again\\n")
"""
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[3])}
    subprocess.run([sys.executable, "-c", code], check=True, env=environment)
    assert path.read_text().split("\n") == ["whole", "not ", "again", ""]
