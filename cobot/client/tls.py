"""Which certificates a client trusts."""

from __future__ import annotations

import os
import ssl
from pathlib import Path

from cobot.errors import InputError

CERTIFICATE_VARIABLE = "COBOT_CERTIFICATE"
TOKEN_VARIABLE = "COBOT_TOKEN"
Verify = bool | str | Path | ssl.SSLContext
END = "-----END CERTIFICATE-----"


def token_from_environment() -> str | None:
    """The access token that `COBOT_TOKEN` holds."""
    return os.environ.get(TOKEN_VARIABLE) or None


def tls_context(verify: Verify) -> ssl.SSLContext:
    """For a connection to a service.

    Args:
        verify: True for what the computer trusts, or the file that `COBOT_CERTIFICATE` names. A file: the
            service's own certificate (PEM, the first one in it), and no other, whatever host it was made out
            to. False for any, which protects from those who listen but not from those who step between.

    Raises:
        InputError: the file is none.
    """
    if isinstance(verify, ssl.SSLContext):
        return verify
    if verify is True:
        verify = os.environ.get(CERTIFICATE_VARIABLE) or True
    if verify is True:
        return ssl.create_default_context()
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname = False
    if verify is False:
        context.verify_mode = ssl.CERT_NONE
        return context
    try:
        first, end, _ = Path(verify).read_text(encoding="ascii").partition(END)
        # Only the first one: with the others of a chain, whatever their issuers have signed would do.
        context.load_verify_locations(cadata=first + end)
    except (OSError, ValueError) as exc:  # an SSLError is an OSError
        raise InputError(f"certificate {verify}: {exc}") from exc
    context.verify_flags |= ssl.VERIFY_X509_PARTIAL_CHAIN
    return context
