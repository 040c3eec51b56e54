"""Certificates. Oracles: `openssl` makes them, and Python's own ssl shakes hands with them."""

from __future__ import annotations

import shutil
import socket
import ssl
import threading
from pathlib import Path

import pytest
from certificates import certificate

from cobot.access.tls import check_certificate
from cobot.client.tls import tls_context
from cobot.config import Settings, load_settings
from cobot.errors import ConfigError, InputError

pytestmark = pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl is not installed")


def with_tls(folder: Path, text: str) -> Settings:
    file = folder / "settings.yaml"
    file.write_text(f"web: {{{text}}}\n", encoding="utf-8")
    return load_settings(file)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with good.pem, good.key, other.pem, other.key, locked.key."""
    folder = tmp_path_factory.mktemp("certificates")
    certificate(folder, "good")
    certificate(folder, "other")
    certificate(folder, "locked", passphrase="secret")
    (folder / "text.pem").write_text("hello", encoding="utf-8")
    broken = (folder / "good.pem").read_text(encoding="ascii").replace("MII", "XXX")
    (folder / "broken.pem").write_text(broken, encoding="ascii")
    return folder


def test_a_certificate_and_its_key_are_good_and_none_is_none(made: Path) -> None:
    assert check_certificate(with_tls(made, "tls_certificate: good.pem, tls_key: good.key").web)
    assert not check_certificate(load_settings().web)


@pytest.mark.parametrize("text", ["tls_certificate: good.pem", "tls_key: good.key"])
def test_one_without_the_other_is_refused(made: Path, text: str) -> None:
    with pytest.raises(ConfigError, match="go together: give both, or neither"):
        with_tls(made, text)


@pytest.mark.parametrize(
    ("files", "sentence"),
    [
        (("none.pem", "good.key"), r"web.tls_certificate: .*none\.pem: cannot be read: No such file"),
        (("good.pem", "none.key"), r"web.tls_key: .*none\.key: cannot be read"),
        (("text.pem", "good.key"), r"text\.pem: contains no certificate in PEM form"),
        (("good.pem", "text.pem"), r"text\.pem: contains no key in PEM form"),
        (("good.pem", "other.key"), r"other\.key is not the key of .*good\.pem"),
        (("broken.pem", "good.key"), r"broken\.pem"),
        (("good.pem", "locked.key"), "the key is encrypted; give the service a key without a passphrase"),
    ],
)
def test_what_is_wrong_is_named_with_its_file(made: Path, files: tuple[str, str], sentence: str) -> None:
    settings = with_tls(made, "tls_certificate: {}, tls_key: {}".format(*files))
    with pytest.raises(ConfigError, match=sentence):
        check_certificate(settings.web)


def handshake(made: Path, name: str, client: ssl.SSLContext) -> None:
    """Between a server that has this certificate and a client that connects to "localhost"."""
    server = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    server.load_cert_chain(made / f"{name}.pem", made / f"{name}.key")
    left, right = socket.socketpair()

    def serve() -> None:
        try:
            server.wrap_socket(left, server_side=True).close()
        except OSError:
            left.close()

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        client.wrap_socket(right, server_hostname="localhost").close()
    finally:
        right.close()
        thread.join()


def test_a_client_trusts_the_one_certificate_that_it_is_given_and_no_other(made: Path) -> None:
    handshake(made, "good", tls_context(made / "good.pem"))
    for context in (tls_context(made / "other.pem"), tls_context(True)):
        with pytest.raises(ssl.SSLCertVerificationError):
            handshake(made, "good", context)
    handshake(made, "good", tls_context(False))


def test_of_a_chain_only_the_first_certificate_is_trusted(made: Path) -> None:
    chain = made / "chain.pem"
    chain.write_bytes((made / "good.pem").read_bytes() + (made / "other.pem").read_bytes())
    handshake(made, "good", tls_context(chain))
    with pytest.raises(ssl.SSLCertVerificationError):
        handshake(made, "other", tls_context(chain))


def test_the_environment_names_a_certificate_too(made: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COBOT_CERTIFICATE", str(made / "good.pem"))
    handshake(made, "good", tls_context(True))
    monkeypatch.setenv("COBOT_CERTIFICATE", str(made / "text.pem"))
    with pytest.raises(InputError, match=r"text\.pem"):
        tls_context(True)
