"""Disks that are full or can only be read, descriptors and memory that are used up, under the whole service.

What the system refuses is put into the one call that would meet it. Every answer says what to do; none is a
traceback, and the service goes on.
"""

from __future__ import annotations

import contextlib
import errno
import os
import resource
import tempfile
from collections.abc import Callable
from typing import Any

import pytest
from virtual_service import VirtualService

from app.services.reports.health import HealthService
from cobot.errors import EXHAUSTED

ROWS = "\n".join(f"{0.01 * row:.2f},0,0,0,-1.57,0,1.57,0" for row in range(60_000))


def refusing(number: int) -> Callable[..., Any]:
    def refuse(*_: object, **__: object) -> None:
        raise OSError(number, os.strerror(number))

    return refuse


def require_refusal(service: VirtualService, answer: Any, words: str) -> None:
    assert answer.status_code == 503, answer.text
    assert answer.json()["code"] == "unavailable"
    assert words in answer.json()["detail"]
    assert "Traceback" not in service.output
    assert service.healthy()


@pytest.mark.parametrize("number", EXHAUSTED)
def test_what_the_system_refuses_is_said_with_what_to_do(
    service: VirtualService, number: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(HealthService, "health", refusing(number))
        answer = service.get("/health")
    require_refusal(service, answer, EXHAUSTED[number])


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (MemoryError(), "no memory left"),
        (RuntimeError("can't start new thread"), "no further process or thread"),
    ],
)
def test_a_service_without_memory_says_so(
    service: VirtualService, error: Exception, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise error

    with monkeypatch.context() as patch:
        patch.setattr(HealthService, "health", refuse)
        answer = service.get("/health")
    require_refusal(service, answer, words)


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EROFS])
def test_an_upload_that_the_disk_has_no_room_for_is_not_the_client_s_mistake(
    service: VirtualService, number: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """More than a megabyte waits in a temporary file."""
    with monkeypatch.context() as patch:
        patch.setattr(tempfile.SpooledTemporaryFile, "rollover", refusing(number))
        patch.setattr(tempfile.SpooledTemporaryFile, "_check", refusing(number))
        answer = service.ask("POST", "/trajectory/send_csv", files={"file": ("t.csv", ROWS, "text/csv")})
    require_refusal(service, answer, EXHAUSTED[number])


def test_a_sequence_that_no_disk_has_room_for_is_not_started(
    service: VirtualService, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(tempfile, "TemporaryFile", refusing(errno.ENOSPC))
        answer = service.ask("POST", "/sequences/start", files={"config": ("s.json", b"{}")})
    require_refusal(service, answer, "No space left on device")
    service.go_home()  # the arm is nobody's


def test_a_recordings_folder_that_cannot_be_written_is_said_before_the_sequence(
    service: VirtualService, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr("pathlib.Path.mkdir", refusing(errno.EROFS))
        answer = service.ask(
            "POST", "/sequences/start", files={"config": ("s.json", b"{}")}, data={"bag_path": "bag"}
        )
    assert answer.status_code == 422, answer.text
    assert "cannot be made: Read-only file system" in answer.json()["detail"]
    service.go_home()


def test_a_programs_folder_that_cannot_be_read_is_said(
    service: VirtualService, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr("pathlib.Path.is_file", refusing(errno.EMFILE))
        answer = service.post(f"/{service.name}/RuntimeMachine/loadProgram", {"program": "x.lua"}).json()
    assert EXHAUSTED[errno.EMFILE] in answer["message"], answer


def test_requests_are_refused_and_nothing_dies_while_no_descriptor_is_left(service: VirtualService) -> None:
    """The true limit, as `ulimit -n` sets it."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    descriptors = os.listdir("/proc/self/fd")
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(map(int, descriptors)) + 1, hard))
    taken: list[int] = []
    try:
        with contextlib.suppress(OSError):
            while True:
                taken.append(os.dup(0))
        answer = service.ask("POST", "/sequences/start", files={"config": ("s.json", b"{}")})
        moved = service.post("/robot/move/named", {"name": "home"})
    finally:
        for descriptor in taken:
            os.close(descriptor)
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    assert answer.status_code == 503, answer.text
    assert "Too many open files" in answer.json()["detail"]
    assert moved.json()["success"], "a motion needs none"
    assert service.healthy()
