"""Names that clients without a token give themselves, on virtual time.

Oracle: the header as Python's `urllib.parse.quote` makes it; the names are written out by hand.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from urllib.parse import quote

import pytest
from virtual_service import VirtualService

from cobot.addresses import CLIENT_NAME

PATH = "/robot/control"


@pytest.fixture
def run(service: VirtualService) -> Iterator[VirtualService]:
    yield service
    token = service.post(PATH, {"force": True}).json()["token"]
    service.ask("DELETE", PATH, headers={"X-Control-Token": token})


def holder(run: VirtualService, header: str) -> str:
    run.ask("POST", PATH, json={"force": True}, headers={CLIENT_NAME: header}).raise_for_status()
    return str(run.get(PATH).json()["holder"])


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        ("Anna", '"Anna"'),
        ("Jürgen Groß", '"Jürgen Groß"'),
        ("李 雷", '"李 雷"'),
        ("  Anna \n B  ", '"Anna B"'),
        ('alice" (admin)', '"alice\' (admin)"'),
        ("<img src=x onerror=alert(1)>", '"<img src=x onerror=alert(1)>"'),
        ("a\u202eb\x00", '"a\\u202eb\\x00"'),
        ("", "anonymous"),
        ("   ", "anonymous"),
    ],
)
def test_a_name_is_text_in_quotes_in_one_line(run: VirtualService, name: str, shown: str) -> None:
    assert holder(run, quote(name)) == shown


def test_a_long_name_is_cut(run: VirtualService) -> None:
    assert holder(run, quote("𝄞" * 5000)).startswith('"' + "𝄞" * 40 + "...")
    assert len(holder(run, "x" * 5000)) < 80


def test_bytes_that_are_no_text_do_no_harm(run: VirtualService) -> None:
    assert holder(run, "%ff%fe%") == '"��%"'


def test_the_audit_has_the_name(run: VirtualService) -> None:
    name = {CLIENT_NAME: quote("Jürgen")}
    answer = run.ask("POST", "/stop", headers=name)
    entries = run.get("/audit?limit=5").json()["entries"]
    entry = next(each for each in entries if each["request"] == answer.headers["x-request-id"])
    assert entry["who"] == '"Jürgen"'


def test_a_name_in_the_address_of_a_stream_counts_as_the_header_does(run: VirtualService) -> None:
    with run.connect(f"/robot/stream?client_name={quote('李')}") as socket:
        socket.send(json.dumps({"type": "control", "timeout_s": 5.0}))
        while json.loads(socket.recv()).get("type") != "control":
            pass
        assert run.get(PATH).json()["holder"] == '"李"'


def test_a_name_grants_nothing(run: VirtualService) -> None:
    assert holder(run, "admin") == '"admin"', "in quotes it differs from a token of this name"
