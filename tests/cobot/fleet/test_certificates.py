"""The certificates of a fleet and signed commands.

Oracles: the command line `openssl`, which verifies chains and purposes; certificates that another authority
or a cell has made, which must not pass.
"""

from __future__ import annotations

import shutil
import stat
import subprocess
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("cryptography")

from cobot.errors import CobotError, ConfigError, ConflictError, InputError, PermissionDenied
from cobot.fleet.__main__ import main
from cobot.fleet.certificates import (
    SignedCommand,
    Signer,
    Verifier,
    cells_with_certificates,
    check_cell_folder,
    issue_cell,
    issue_hub,
    make_authority,
)
from cobot.fleet.messages import FleetCommand, StartProgram, written

COMMAND = FleetCommand(
    id="12345678",
    fleet="hall",
    cell="one",
    robot="*",
    action=StartProgram(kind="start", program="pick"),
    who="ada",
    role="operator",
    epoch="0123456789abcdef",
    issued_s=1.0,
    expires_s=3.0,
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    made = tmp_path / "hall"
    make_authority(made, "hall")
    issue_hub(made, ["hub.example", "192.0.2.7"], 30)
    issue_cell(made, "one", 30)
    return made


def openssl(folder: Path, file: str, purpose: str) -> bool:
    command = ["openssl", "verify", "-CAfile", "ca.pem", "-purpose", purpose, file]
    return subprocess.run(command, cwd=folder, capture_output=True, check=False).returncode == 0


@pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl is not installed")
def test_only_the_hub_may_be_a_server(folder: Path) -> None:
    hub, cell = "hub/hub.pem", "cells/one/cell.pem"
    assert openssl(folder, hub, "sslserver")
    assert openssl(folder, hub, "sslclient")
    assert openssl(folder, cell, "sslclient")
    assert not openssl(folder, cell, "sslserver")
    shown = subprocess.run(
        ["openssl", "x509", "-in", hub, "-noout", "-ext", "subjectAltName"],
        cwd=folder, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert "DNS:hub.example, IP Address:192.0.2.7" in shown.stdout


def test_keys_are_readable_by_their_owner_only(folder: Path) -> None:
    keys = list(folder.rglob("*.key"))
    assert len(keys) == 3
    assert {stat.S_IMODE(key.stat().st_mode) for key in keys} == {0o600}
    assert {path.name for path in (folder / "cells" / "one").iterdir()} == {"ca.pem", "cell.key", "cell.pem"}
    assert cells_with_certificates(folder) == ["one"]


def test_a_signed_command_is_read_by_a_cell(folder: Path) -> None:
    signed = written(Signer(folder).signed(COMMAND))
    assert Verifier(folder / "cells" / "one").command_of(signed) == COMMAND


def changed(signed: SignedCommand, **values: str) -> SignedCommand:
    return signed.model_copy(update=values)


def test_a_forged_command_is_refused(folder: Path, tmp_path: Path) -> None:
    verifier = Verifier(folder / "cells" / "one")
    signed = Signer(folder).signed(COMMAND)
    other = tmp_path / "other"
    make_authority(other, "other")
    issue_hub(other, ["hub.example"], 30)
    foreign = Signer(other).signed(COMMAND)
    posing = tmp_path / "posing" / "hub"
    posing.mkdir(parents=True)
    for end in ("pem", "key"):
        shutil.copy(folder / "cells" / "one" / f"cell.{end}", posing / f"hub.{end}")
    forged = [
        (changed(signed, command=signed.command.replace("pick", "drop")), "not signed by a hub"),
        (changed(signed, signature=foreign.signature), "not signed by a hub"),
        (changed(signed, signature="no base64!"), "is not valid"),
        (changed(signed, certificate="no certificate"), "is not valid"),
        (foreign, "is not valid"),
        (Signer(posing.parent).signed(COMMAND), "signed by a cell"),
    ]
    for each, words in forged:
        with pytest.raises(PermissionDenied, match=words):
            verifier.command_of(written(each))


@pytest.mark.parametrize("content", [written(COMMAND), b"", b"\xff", b"[]", b'{"command": 1}'])
def test_what_is_not_signed_is_invalid(folder: Path, content: bytes) -> None:
    with pytest.raises(InputError, match="SignedCommand"):
        Verifier(folder / "cells" / "one").command_of(content)


def test_an_expired_certificate_of_the_hub_is_refused(folder: Path) -> None:
    shutil.rmtree(folder / "hub")
    issue_hub(folder, ["hub.example"], 0)
    with pytest.raises(PermissionDenied, match=r"valid until .* check the clock"):
        Verifier(folder / "cells" / "one").command_of(written(Signer(folder).signed(COMMAND)))


def swap_key(folder: Path) -> None:
    shutil.copy(folder / "ca.key", folder / "hub" / "hub.key")


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda folder: (folder / "hub" / "hub.pem").unlink(), "cannot be read"),
        (lambda folder: (folder / "hub" / "hub.pem").write_text("x"), "is not valid"),
        (lambda folder: (folder / "hub" / "hub.key").write_bytes(b"\0" * 9), "is not valid"),
        (swap_key, "is not the key of"),
    ],
)
def test_files_that_cannot_be_used_are_named(folder: Path, damage: Any, words: str) -> None:
    damage(folder)
    with pytest.raises(ConfigError, match=words) as caught:
        Signer(folder)
    assert str(folder / "hub") in str(caught.value)


def swap_cells(folder: Path) -> None:
    issue_cell(folder, "two", 30)
    shutil.copy(folder / "cells" / "two" / "cell.key", folder / "cells" / "one" / "cell.key")


def change_authority(folder: Path) -> None:
    make_authority(folder / "other", "other")
    shutil.copy(folder / "other" / "ca.pem", folder / "cells" / "one" / "ca.pem")


def expire(folder: Path) -> None:
    shutil.rmtree(folder / "cells" / "one")
    issue_cell(folder, "one", 0)


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda folder: (folder / "cells" / "one" / "cell.pem").unlink(), "cannot be read"),
        (swap_cells, "cell.key is not the key of cell.pem"),
        (change_authority, "cell.pem is not issued by ca.pem"),
        (expire, "cell.pem expired on"),
    ],
)
def test_cobot_check_names_what_is_wrong_with_a_cells_certificate(
    folder: Path, damage: Any, words: str
) -> None:
    own = folder / "cells" / "one"
    check_cell_folder(own)
    damage(folder)
    with pytest.raises(ConfigError, match=words):
        check_cell_folder(own)


def test_no_certificate_is_written_over_or_through_a_link(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(ConflictError, match="already contains a certificate"):
        issue_cell(folder, "one", 30)
    target = tmp_path / "target"
    (folder / "cells" / "two").mkdir()
    (folder / "cells" / "two" / "cell.key").symlink_to(target)
    with pytest.raises(CobotError):
        issue_cell(folder, "two", 30)
    assert not target.exists()


def test_the_command_line_makes_them_and_rejects_wrong_names(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = str(tmp_path / "hall-3")
    assert main(["certificate", folder, "hub", "localhost", "127.0.0.1"]) == 0
    assert f"cobot fleet serve --certificates {folder} --listen tls/localhost:7447" in capsys.readouterr().out
    assert main(["certificate", folder, "cell", "welding", "gluing"]) == 0
    assert "copy" in capsys.readouterr().out
    for words, problem in (
        (("cell", "../up"), "'../up' is not valid"),
        (("hub", "a b"), "'a b' is not valid"),
        (("cell", "three", "--days", "0"), "allowed: 1 to 3650"),
        (("cell", "welding"), "already contains a certificate"),
    ):
        assert main(["certificate", folder, *words]) == 1
        assert problem in capsys.readouterr().err
