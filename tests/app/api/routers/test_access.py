"""Access tokens over REST, on virtual time. Oracles: the file of the tokens, read by `json`; hashlib; whether
a token opens the service."""

from __future__ import annotations

import hashlib
import json
import stat
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from typing import Any

import httpx
import pytest
from asgi_client import Closed
from streaming_client import Frames
from virtual_service import SynchronousTransport, VirtualService, virtual_service

from cobot.access import tokens as module
from cobot.access.roles import Role
from cobot.access.tokens import TokenFile
from cobot.client import Client
from cobot.errors import ConflictError, NotFoundError

PATH = "/access/tokens"


class Guarded:
    """A service that requires tokens, one of an administrator and one of an operator."""

    def __init__(self, run: VirtualService, file: TokenFile) -> None:
        self.run, self.file = run, file
        self.admin = file.create("root", Role.ADMIN)
        self.operator = file.create("olga", Role.OPERATOR)

    def ask(self, method: str, path: str = PATH, token: str | None = None, **content: Any) -> httpx.Response:
        headers = {"Authorization": f"Bearer {token or self.admin}"}
        return self.run.ask(method, path, headers=headers, **content)

    def create(self, name: str, role: str = "observer", **more: Any) -> httpx.Response:
        return self.ask("POST", json={"name": name, "role": role, **more})

    def take_control(self, token: str) -> None:
        """As soon as nothing moves any more."""
        body = {"timeout_s": 3600.0}
        self.run.until(lambda: self.ask("POST", "/robot/control", token, json=body).status_code == 200)

    def opens(self, token: str) -> bool:
        return self.ask("GET", "/health", token).status_code == 200

    @property
    def names(self) -> list[str]:
        return [each["name"] for each in json.loads(self.file.path.read_text(encoding="utf-8"))]


@pytest.fixture(scope="module")
def started(tmp_path_factory: pytest.TempPathFactory) -> Iterator[VirtualService]:
    web = "web: {authentication: required, tokens: of/tokens.json}\n"
    with virtual_service(tmp_path_factory.mktemp("access"), more=web) as run:
        yield run


@pytest.fixture
def guarded(started: VirtualService) -> Guarded:
    file = started.app.state.tokens.file
    file.path.unlink(missing_ok=True)
    return Guarded(started, file)


def test_a_token_is_answered_once_is_valid_at_once_and_the_list_never_has_it(guarded: Guarded) -> None:
    answer = guarded.create("anna", "operator", days=2)
    assert answer.status_code == 200, answer.text
    assert answer.headers["cache-control"] == "no-store"
    made = answer.json()
    assert (made["name"], made["role"]) == ("anna", "operator")
    assert abs(datetime.fromisoformat(made["expires"]) - datetime.now(UTC) - timedelta(days=2)) < timedelta(
        minutes=5
    )
    assert guarded.opens(made["token"])
    listed = guarded.ask("GET")
    digest = hashlib.sha256(made["token"].encode()).hexdigest()
    assert made["token"] not in listed.text
    assert digest not in listed.text
    content = listed.json()
    assert content["required"]
    assert content["hint"] == ""
    known = {each["name"]: each for each in content["tokens"]}
    assert list(known) == ["root", "olga", "anna"]
    assert [each["own"] for each in known.values()] == [True, False, False]
    assert known["anna"]["last_used"] is not None
    assert known["olga"]["last_used"] is None
    assert [each["sha256"] for each in json.loads(guarded.file.path.read_text())][2] == digest
    assert stat.S_IMODE(guarded.file.path.stat().st_mode) == 0o600


def test_a_deleted_token_is_invalid_at_once_and_its_websocket_is_closed(guarded: Guarded) -> None:
    run, token = guarded.run, guarded.create("leaving", "operator").json()["token"]
    with Frames(run.connect("/robot/stream", authorization=f"Bearer {token}")) as client:
        client.session()
        assert guarded.opens(token)
        begun_s = run.loop.time()
        gone = guarded.ask("DELETE", f"{PATH}/leaving")
        assert (gone.status_code, gone.json()["name"]) == (200, "leaving")
        assert not guarded.opens(token)
        with pytest.raises(Closed, match="1008"):
            client.until_closed()
    assert run.loop.time() - begun_s < 0.2, "not with the next look at the file, after 0.5 s"
    again = guarded.ask("DELETE", f"{PATH}/leaving")
    assert (again.status_code, again.json()["code"]) == (404, "not_found")
    assert "valid names: root, olga" in again.json()["detail"]


def test_the_control_of_a_deleted_token_ends_at_once(guarded: Guarded) -> None:
    """Oracle: what the next client may do, and the events."""
    run, token = guarded.run, guarded.create("leaving", "operator").json()["token"]
    guarded.take_control(token)
    assert guarded.ask("POST", "/robot/control", guarded.operator, json={}).status_code == 409
    ring = run.app.state.services.link.events.ring
    before = ring.newest
    assert guarded.ask("DELETE", f"{PATH}/leaving").status_code == 200
    told = [json.loads(each.text) for each in ring.since(before, 100)]
    (lost,) = (each["data"] for each in told if each["type"] == "lease")
    assert (lost["what"], lost["holder"]) == ("revoked", "leaving")
    assert guarded.ask("GET", "/robot/control").json()["held"] is False
    mine = guarded.ask("POST", "/robot/control", guarded.operator, json={})
    assert mine.status_code == 200
    headers = {"X-Control-Token": mine.json()["token"], "Authorization": f"Bearer {guarded.operator}"}
    assert run.ask("DELETE", "/robot/control", headers=headers).status_code == 200


def test_the_control_of_a_token_that_the_command_line_has_deleted_ends(guarded: Guarded) -> None:
    _, token = guarded.file.create_entry("brief", Role.OPERATOR, timedelta(days=1), by="root")
    guarded.take_control(token)
    guarded.file.revoke("brief", by="root")  # as by `cobot token revoke`, in another process
    guarded.run.sleep(1.0)
    assert guarded.ask("GET", "/robot/control").json()["held"] is False


def test_only_an_administrator_sees_and_changes_tokens(guarded: Guarded) -> None:
    for method, path, content in (
        ("GET", PATH, {}),
        ("POST", PATH, {"json": {"name": "x", "role": "admin"}}),
        ("DELETE", f"{PATH}/root", {}),
    ):
        answer = guarded.ask(method, path, guarded.operator, **content)
        assert (answer.status_code, answer.json()["code"]) == (403, "forbidden")
        assert "needs the role admin" in answer.json()["detail"]
    assert guarded.names == ["root", "olga"]


def test_the_last_administrator_and_the_own_token_stay(
    guarded: Guarded, monkeypatch: pytest.MonkeyPatch
) -> None:
    last = guarded.ask("DELETE", f"{PATH}/root?own=true")
    assert last.status_code == 409
    assert "create another one first" in last.json()["detail"]
    monkeypatch.setattr(module, "MIN_LIFETIME", timedelta(0))
    expired = guarded.file.create_entry("old", Role.ADMIN, timedelta(microseconds=1))[0]
    assert expired.expires is not None
    assert guarded.ask("DELETE", f"{PATH}/root?own=true").status_code == 409, "an expired one does not count"
    other = guarded.create("second", "admin").json()["token"]
    own = guarded.ask("DELETE", f"{PATH}/root")
    assert own.status_code == 409
    assert "confirm it with own=true" in own.json()["detail"]
    assert guarded.ask("DELETE", f"{PATH}/root?own=true").status_code == 200
    assert not guarded.opens(guarded.admin)
    assert guarded.ask("DELETE", f"{PATH}/second?own=true", other).status_code == 409
    assert guarded.names == ["olga", "old", "second"]


def test_no_name_is_given_to_a_second_token_so_that_none_is_demoted(guarded: Guarded) -> None:
    answer = guarded.create("root", "observer")
    assert (answer.status_code, answer.json()["code"]) == (409, "conflict")
    assert "token 'root' already exists" in answer.json()["detail"]
    assert guarded.opens(guarded.admin)


@pytest.mark.parametrize(
    "body",
    [
        {"name": "<img src=x onerror=alert(1)>", "role": "admin"},
        {"name": "../../etc/passwd", "role": "admin"},
        {"name": "..", "role": "admin"},
        {"name": "a\nb", "role": "admin"},
        {"name": "", "role": "admin"},
        {"name": "x" * 49, "role": "admin"},
        {"name": "cobot", "role": "admin"},
        {"name": "ros2", "role": "admin"},
        {"name": 7, "role": "admin"},
        {"name": "x", "role": "public"},
        {"name": "x", "role": "root"},
        {"name": "x"},
        {"name": "x", "role": "admin", "days": 0},
        {"name": "x", "role": "admin", "days": 1e9},
        {"name": "x", "role": "admin", "days": 1e-12},  # Python rounds it to no time at all
        {"name": "x", "role": "admin", "days": "NaN"},
        {"name": "x", "role": "admin", "sha256": "0" * 64},
    ],
)
def test_what_is_no_token_is_rejected_and_nothing_is_written(guarded: Guarded, body: dict[str, Any]) -> None:
    before = guarded.file.path.read_bytes()
    answer = guarded.ask("POST", json=body)
    assert (answer.status_code, answer.json()["code"]) == (422, "input"), answer.text
    assert guarded.file.path.read_bytes() == before


def test_the_number_of_tokens_is_bounded(guarded: Guarded, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MAX_TOKENS", 5)
    answers = [guarded.create(f"n{number}") for number in range(10)]
    assert [each.status_code for each in answers] == [200] * 3 + [409] * 7
    assert "there are 5 tokens, allowed: 5; revoke one" in answers[-1].json()["detail"]
    assert len(guarded.names) == 5


def test_two_at_once_lose_nothing_and_two_administrators_do_not_revoke_each_other(guarded: Guarded) -> None:
    run = guarded.run

    def begun(method: str, path: str, token: str, **content: Any) -> Any:
        headers = {"Authorization": f"Bearer {token}"}
        return run.begin(run.asking(method, path, headers=headers, **content))

    made = [
        begun("POST", PATH, guarded.admin, json={"name": f"n{number}", "role": "observer"})
        for number in range(8)
    ]
    guarded.file.create("by-the-command", Role.OBSERVER)
    assert [run.end(each).status_code for each in made] == [200] * 8
    assert {*guarded.names} == {"root", "olga", "by-the-command", *(f"n{number}" for number in range(8))}
    other = guarded.create("second", "admin").json()["token"]
    both = [
        begun("DELETE", f"{PATH}/second", guarded.admin),
        begun("DELETE", f"{PATH}/root", other),
    ]
    assert sorted(run.end(each).status_code for each in both)[0] == 200
    assert len({"root", "second"} & {*guarded.names}) == 1


def test_a_program_that_an_administrator_runs_creates_no_token(guarded: Guarded) -> None:
    """A programmer's program that an administrator starts must not make the programmer an administrator."""
    lent = guarded.run.app.state.tokens.grant("root", Role.ADMIN)
    answer = guarded.ask("POST", token=lent, json={"name": "x", "role": "admin"})
    assert (answer.status_code, answer.json()["code"]) == (409, "conflict")
    assert guarded.ask("DELETE", f"{PATH}/olga", lent).status_code == 409
    assert guarded.ask("GET", token=lent).json()["hint"]
    assert guarded.names == ["root", "olga"]


def test_the_audit_names_the_token_and_never_contains_it(guarded: Guarded) -> None:
    token = guarded.create("anna", "programmer").json()["token"]
    guarded.ask("DELETE", f"{PATH}/anna")
    audit = guarded.ask("GET", "/audit?limit=5")
    found = [each for each in audit.json()["entries"] if each["what"].endswith(PATH)]
    assert found[0]["who"] == "root"
    assert (found[0]["details"]["token"], found[0]["details"]["role"]) == ("anna", "programmer")
    assert any(each["what"] == f"DELETE {PATH}/anna" for each in audit.json()["entries"])
    assert token not in audit.text + guarded.run.output


def test_a_spoilt_file_is_reported_and_stays(guarded: Guarded) -> None:
    lent = guarded.run.app.state.tokens.grant("root", Role.ADMIN)
    guarded.file.path.write_text("[", encoding="utf-8")
    answer = guarded.ask("GET", token=lent)
    assert (answer.status_code, answer.json()["code"]) == (503, "config")
    assert "tokens.json" in answer.json()["detail"]
    assert guarded.file.path.read_text(encoding="utf-8") == "["


def test_without_tokens_the_list_says_what_to_do_and_nobody_creates_one(service: VirtualService) -> None:
    answer = service.get(PATH)
    assert answer.status_code == 200, answer.text
    assert not answer.json()["required"]
    for part in ("cobot token create NAME --role admin", "web.authentication: required"):
        assert part in answer.json()["hint"]
    refused = service.post(PATH, {"name": "x", "role": "admin"})
    assert (refused.status_code, refused.json()["code"]) == (409, "conflict")
    assert refused.json()["detail"] == answer.json()["hint"]
    assert not any(each["name"] == "x" for each in service.get(PATH).json()["tokens"])


def test_the_client_lists_creates_and_deletes(guarded: Guarded) -> None:
    transport = SynchronousTransport(guarded.run)
    with Client(guarded.run.url, token=guarded.admin, transport=transport) as client:
        made = client.create_access_token("anna", "observer", days=1.0)
        assert guarded.opens(made["token"])
        assert [each["name"] for each in client.access_tokens()["tokens"]] == ["root", "olga", "anna"]
        with pytest.raises(ConflictError):
            client.delete_access_token("root")
        assert client.delete_access_token("anna")["name"] == "anna"
        with pytest.raises(NotFoundError):
            client.delete_access_token("anna")
