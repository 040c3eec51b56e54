"""The file of tokens. Oracles: hashlib, the file system's own modes, JSON read by `json`."""

from __future__ import annotations

import fcntl
import hashlib
import hmac
import json
import os
import signal
import stat
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from datetime import timedelta
from pathlib import Path

import pytest
from virtual_time import VirtualClock, VirtualLoop

from cobot.access import authentication
from cobot.access import tokens as tokens_module
from cobot.access.authentication import Authenticator, Holder
from cobot.access.roles import Role
from cobot.access.tokens import TokenFile
from cobot.errors import (
    ConfigError,
    ConflictError,
    InputError,
    NotFoundError,
    PermissionDenied,
    UnavailableError,
)
from cobot.launch.cli import main


@pytest.fixture
def file(tmp_path: Path) -> TokenFile:
    return TokenFile(tmp_path / "of/a/user/tokens.json")


def test_only_the_hash_of_a_token_is_kept_and_nobody_else_may_read_it(file: TokenFile) -> None:
    token = file.create("alice", Role.OPERATOR)
    text = file.path.read_text(encoding="utf-8")
    (kept,) = json.loads(text)
    assert len(token) > 40
    assert token not in text
    assert (kept["name"], kept["role"]) == ("alice", "operator")
    assert kept["sha256"] == hashlib.sha256(token.encode()).hexdigest()
    assert stat.S_IMODE(file.path.stat().st_mode) == 0o600
    assert stat.S_IMODE(file.path.parent.stat().st_mode) == 0o700


def test_no_two_tokens_are_alike_and_no_two_have_one_name(file: TokenFile) -> None:
    tokens = {file.create(f"n{number}", Role.OBSERVER) for number in range(20)}
    assert len(tokens) == 20
    with pytest.raises(ConflictError, match="token 'n3' already exists"):
        file.create("n3", Role.ADMIN)


def test_behind_a_link_the_file_itself_is_changed(file: TokenFile, tmp_path: Path) -> None:
    """Otherwise a revoked token would stay in the file, for every other service that reads it."""
    file.create("alice", Role.ADMIN)
    linked = TokenFile(tmp_path / "linked.json")
    linked.path.symlink_to(file.path)
    linked.create("bob", Role.OPERATOR)
    linked.revoke("alice")
    assert linked.path.is_symlink()
    assert [each["name"] for each in json.loads(file.path.read_text(encoding="utf-8"))] == ["bob"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["linked.json", "of"]


def test_those_who_change_it_at_one_time_lose_nothing(file: TokenFile) -> None:
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(lambda number: file.create(f"n{number}", Role.OBSERVER), range(40)))
    assert {each.name for each in file.read()} == {f"n{number}" for number in range(40)}
    assert [path.name for path in file.path.parent.iterdir()] == ["tokens.json"]


def test_a_program_that_is_killed_while_it_writes_changes_nothing_and_leaves_nothing(file: TokenFile) -> None:
    """Oracle: SIGKILL, right before the new file takes the place of the old one."""
    file.create("alice", Role.OPERATOR)
    before = file.path.read_bytes()
    program = (
        "import os, signal, sys; from pathlib import Path; from cobot.access.roles import Role\n"
        "from cobot.access.tokens import TokenFile\n"
        "os.replace = lambda *_: os.kill(os.getpid(), signal.SIGKILL)\n"
        "TokenFile(Path(sys.argv[1])).create('bob', Role.ADMIN)"
    )
    killed = subprocess.run([sys.executable, "-c", program, str(file.path)], check=False)
    assert killed.returncode == -signal.SIGKILL
    assert file.path.read_bytes() == before
    assert len(list(file.path.parent.iterdir())) == 2
    file.create("carl", Role.OBSERVER)
    assert [each.name for each in file.read()] == ["alice", "carl"]
    assert [path.name for path in file.path.parent.iterdir()] == ["tokens.json"]


def test_a_program_that_keeps_the_file_locked_is_reported(
    file: TokenFile, monkeypatch: pytest.MonkeyPatch
) -> None:
    file.create("alice", Role.OPERATOR)
    monkeypatch.setattr(tokens_module, "LOCKED_S", 0.05)
    folder = os.open(file.path.parent, os.O_RDONLY)
    try:
        fcntl.flock(folder, fcntl.LOCK_EX)
        with pytest.raises(UnavailableError, match="another program has been changing it for"):
            file.revoke("alice")
    finally:
        os.close(folder)
    file.revoke("alice")


def test_two_administrators_cannot_revoke_each_other(file: TokenFile) -> None:
    for name in ("alice", "bob"):
        file.create(name, Role.ADMIN)
    file.revoke("bob", by="alice")
    with pytest.raises(PermissionDenied, match="bob is not the name of a valid token of an administrator"):
        file.revoke("alice", by="bob")
    with pytest.raises(ConflictError, match="alice is the last token of an administrator"):
        file.revoke("alice", by="alice", own=True)
    file.revoke("alice")  # the command may


@pytest.mark.parametrize("name", ["", "a b", "a\n", "x" * 49, "anonymous", "ros2", "cobot", "../x", ".."])
def test_a_name_is_a_name_and_none_of_the_service_s_own(file: TokenFile, name: str) -> None:
    with pytest.raises(InputError, match="name"):
        file.create(name, Role.OBSERVER)
    assert file.read() == ()


def test_what_is_revoked_is_gone(file: TokenFile) -> None:
    file.create("alice", Role.OPERATOR)
    file.create("bob", Role.OBSERVER)
    file.revoke("alice")
    assert [each.name for each in file.read()] == ["bob"]
    with pytest.raises(NotFoundError, match="there is no token 'alice'; valid names: bob"):
        file.revoke("alice")


def test_a_spoilt_file_is_said_to_be_and_stays(file: TokenFile) -> None:
    file.create("alice", Role.OPERATOR)
    file.path.write_text('[{"name": "alice"}]', encoding="utf-8")
    for use in (file.read, lambda: file.create("bob", Role.ADMIN), lambda: file.revoke("alice")):
        with pytest.raises(ConfigError, match=r"tokens\.json: .*role: is missing"):
            use()
    assert file.path.read_text(encoding="utf-8") == '[{"name": "alice"}]'


def test_what_is_no_file_keeps_nobody_waiting(file: TokenFile) -> None:
    """A pipe that nobody writes to, and a device without an end."""
    file.create("alice", Role.OPERATOR)
    file.path.unlink()
    os.mkfifo(file.path, 0o600)
    with pytest.raises(ConfigError, match=r"tokens\.json: is not a regular file"):
        file.read()
    file.path.unlink()
    file.path.symlink_to("/dev/zero")
    with pytest.raises(ConfigError, match=r"tokens\.json: is not a regular file"):
        file.read()


def test_a_file_that_others_may_change_gives_nobody_rights(file: TokenFile) -> None:
    file.create("alice", Role.OPERATOR)
    file.path.chmod(0o620)
    with pytest.raises(ConfigError, match="other users may change this file, and so control the robot"):
        file.read()


@pytest.fixture
def clock() -> Iterator[VirtualClock]:
    loop = VirtualLoop()
    yield VirtualClock(loop)
    loop.close()


def test_a_token_is_known_and_a_revoked_one_no_more_within_a_second(
    file: TokenFile, clock: VirtualClock
) -> None:
    tokens = Authenticator(file, clock)
    token = file.create("alice", Role.OPERATOR)
    clock.sleep(1.0)
    assert tokens.find(token) == Holder("alice", Role.OPERATOR, stored=True)
    for other in (
        "",
        "alice",
        token[:-1],
        f"{token} ",
        token.upper(),
        "\udcff",
        hashlib.sha256(token.encode()).hexdigest(),
    ):
        assert tokens.find(other) is None
    file.revoke("alice")
    clock.sleep(1.0)
    assert tokens.find(token) is None


def test_a_new_token_is_valid_at_once(file: TokenFile, clock: VirtualClock) -> None:
    tokens = Authenticator(file, clock)
    for name in ("alice", "bob"):
        token = file.create(name, Role.OPERATOR)
        assert tokens.find(token) == Holder(name, Role.OPERATOR, stored=True)


def test_a_token_expires(file: TokenFile, clock: VirtualClock, monkeypatch: pytest.MonkeyPatch) -> None:
    token = file.create("alice", Role.OPERATOR, timedelta(hours=1))
    tokens = Authenticator(file, clock)
    made_ns = int(file.read()[0].created.timestamp() * 1e9)
    monkeypatch.setattr(clock, "wall_ns", lambda: made_ns + 3599 * 10**9)
    assert tokens.find(token) is not None
    monkeypatch.setattr(clock, "wall_ns", lambda: made_ns + 3600 * 10**9)
    assert tokens.find(token) is None


def test_a_file_that_is_spoilt_later_opens_to_nobody_until_it_is_mended(
    file: TokenFile, clock: VirtualClock
) -> None:
    token = file.create("alice", Role.OPERATOR)
    tokens = Authenticator(file, clock)
    good = file.path.read_bytes()
    file.path.write_text("[", encoding="utf-8")
    clock.sleep(1.0)
    assert tokens.find(token) is None
    restarted = Authenticator(file, clock)
    assert restarted.find(token) is None
    file.path.write_bytes(good)
    clock.sleep(1.0)
    assert tokens.find(token) is not None
    file.path.unlink()
    clock.sleep(1.0)
    assert tokens.find(token) is None


def test_a_granted_token_is_valid_until_it_is_withdrawn_and_stands_in_no_file(
    file: TokenFile, clock: VirtualClock
) -> None:
    tokens = Authenticator(file, clock)
    token = tokens.grant("alice", Role.PROGRAMMER)
    assert tokens.find(token) == Holder("alice", Role.PROGRAMMER)
    assert not file.path.exists()
    tokens.withdraw(token)
    tokens.withdraw(token)
    assert tokens.find(token) is None


def test_hashes_are_compared_in_constant_time_and_all_of_them(
    file: TokenFile, clock: VirtualClock, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = [file.create(f"n{number}", Role.OBSERVER) for number in range(5)]
    tokens = Authenticator(file, clock)
    compared: list[tuple[bytes, bytes]] = []
    real = hmac.compare_digest

    def compare(one: bytes, other: bytes) -> bool:
        compared.append((one, other))
        return real(one, other)

    monkeypatch.setattr(authentication.hmac, "compare_digest", compare)
    for token in (made[0], made[4], "nobody's"):
        compared.clear()
        tokens.find(token)
        digest = hashlib.sha256(token.encode()).digest()
        assert {one for one, _ in compared} == {hashlib.sha256(each.encode()).digest() for each in made}
        assert {other for _, other in compared} == {digest}


def test_the_command_makes_lists_and_revokes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = tmp_path / "mine.yaml"
    config.write_text("web: {tokens: tokens.json}\n", encoding="utf-8")
    here = ["--config", str(config)]

    def run(*words: str) -> tuple[int, str, str]:
        status = main(["token", *words, *here])
        said = capsys.readouterr()
        return status, said.out.strip(), said.err.strip()

    status, token, _ = run("create", "alice", "--role", "operator", "--days", "7")
    assert status == 0
    assert Authenticator(TokenFile(tmp_path / "tokens.json")).find(token) == Holder(
        "alice", Role.OPERATOR, stored=True
    )
    status, said, _ = run("list")
    assert status == 0
    assert said.startswith("alice")
    assert "operator" in said
    assert "until" in said
    assert token not in said
    status, _, complaint = run("create", "alice", "--role", "admin")
    assert status == 1
    assert "token 'alice' already exists" in complaint
    assert run("revoke", "alice")[0] == 0
    assert run("revoke", "alice")[0] == 1
    assert run("list")[1] == ""
    for days in ("0", "-1", "nan", "x", "1e400"):
        with pytest.raises(SystemExit, match="2"):
            main(["token", "create", "bob", "--role", "admin", "--days", days, *here])
    for days in ("99999999999", "36501", "inf"):
        with pytest.raises(SystemExit, match="2"):
            main(["token", "create", "bob", "--role", "admin", "--days", days, *here])
        assert f"'{days}' days are too many, allowed: up to 36500" in capsys.readouterr().err
    status, _, complaint = run("create", "bob", "--role", "admin", "--days", "1e-12")
    assert status == 1
    assert "the lifetime is 0 s, allowed: 60 s or more" in complaint
    assert run("list")[1] == ""
    assert run("create", "bob", "--role", "observer", "--days", "36500")[0] == 0


@pytest.mark.skipif(os.geteuid() != 0, reason="needs root")
def test_root_makes_a_token_for_the_user_that_the_folder_belongs_to(tmp_path: Path) -> None:
    os.chown(tmp_path, 1234, 1235)
    file = TokenFile(tmp_path / "tokens.json")
    file.create("alice", Role.OBSERVER)
    assert (file.path.stat().st_uid, file.path.stat().st_gid) == (1234, 1235)
    file.revoke("alice")
