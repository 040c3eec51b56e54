"""Checks the certificate of the service and its key before anything starts."""

from __future__ import annotations

import ssl
from pathlib import Path

from cobot.config import WebSection
from cobot.errors import ConfigError


def check_certificate(web: WebSection) -> bool:
    """Check the certificate. Returns whether the service uses TLS.

    Raises:
        ConfigError: the certificate or the key cannot be used; the message names the file and the problem.
    """
    certificate, key = web.tls_certificate, web.tls_key
    if certificate is None or key is None:
        return False
    for name, path in (("certificate", certificate), ("key", key)):
        _require_pem(name, path)
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    try:
        context.load_cert_chain(certificate, key, password=_no_password)
    except ssl.SSLError as exc:
        if exc.reason == "KEY_VALUES_MISMATCH":
            raise ConfigError(f"web.tls_key: {key} is not the key of {certificate}") from exc
        raise ConfigError(
            f"web.tls_certificate, web.tls_key: {certificate} and {key}: {exc.reason or exc}"
        ) from exc
    return True


def _require_pem(name: str, path: Path) -> None:
    setting = f"web.tls_{name}"
    try:
        text = path.read_text(encoding="ascii", errors="replace")
    except OSError as exc:
        raise ConfigError(f"{setting}: {path}: cannot be read: {exc.strerror}") from exc
    if f"{'PRIVATE KEY' if name == 'key' else 'CERTIFICATE'}-----" not in text:
        raise ConfigError(f"{setting}: {path}: contains no {name} in PEM form (-----BEGIN ...)")


def _no_password() -> str:
    """Reject an encrypted key. Otherwise OpenSSL would ask for a password on the terminal and wait."""
    raise ConfigError(
        "web.tls_key: the key is encrypted; give the service a key without a passphrase, with mode 600"
    )
