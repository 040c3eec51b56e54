"""The certificates of a fleet, and commands that the hub has signed.

FLEET/ca.pem, ca.key                the fleet's own authority; ca.key is needed only to issue certificates
FLEET/hub/hub.pem, hub.key          for the hub, which alone may be a server and sign commands
FLEET/cells/CELL/cell.pem, cell.key, ca.pem    for the computer of a cell

Commands are signed although the connection is encrypted, because otherwise a router between the hub and a
cell could forge commands.
"""

from __future__ import annotations

import base64
import contextlib
import os
from collections.abc import Iterable, Iterator
from datetime import UTC, datetime, timedelta
from ipaddress import ip_address
from pathlib import Path
from typing import Annotated

from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID
from pydantic import Field

from cobot.errors import ConfigError, ConflictError, PermissionDenied
from cobot.fleet.messages import FleetCommand, Model, read
from cobot.fleet.names import HUB
from cobot.strict import StrictModel

AUTHORITY, HUB_FOLDER, CELLS = "ca", "hub", "cells"
CELL = "cell"
EARLIER = timedelta(days=1)
"""Certificates are valid from a day before their creation, because the clock of a computer may be late."""
AUTHORITY_DAYS = 3650
CURVE = ec.SECP256R1()


class SignedCommand(StrictModel):
    """A command with the signature of a hub.

    Attributes:
        command: `FleetCommand` or `PanelRequest` as JSON, the text that is signed.
        certificate: certificate of the hub, PEM.
        signature: ECDSA with SHA-256 of `command` in UTF-8, base64.
    """

    command: Annotated[str, Field(max_length=32_768)]
    certificate: Annotated[str, Field(max_length=8192)]
    signature: Annotated[str, Field(max_length=512)]


def make_authority(folder: Path, fleet: str) -> None:
    """Create the fleet's authority, unless the folder already contains one.

    Raises:
        ConfigError: the folder cannot be written.
    """
    if (folder / f"{AUTHORITY}.pem").exists():
        return
    key = ec.generate_private_key(CURVE)
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, f"cobot fleet {fleet}")])
    now = datetime.now(UTC)
    made = (
        x509.CertificateBuilder(name, name, key.public_key(), x509.random_serial_number())
        .not_valid_before(now - EARLIER)
        .not_valid_after(now + timedelta(days=AUTHORITY_DAYS))
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(_usage(signs_certificates=True), critical=True)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
        .sign(key, hashes.SHA256())
    )
    _write(folder, AUTHORITY, made, key)


def issue_hub(folder: Path, hosts: Iterable[str], days: int) -> Path:
    """Issue the hub's certificate. Returns the folder that contains it.

    Args:
        folder: folder of the fleet, with its authority.
        hosts: names and addresses at which cells and browsers reach the hub.

    Raises:
        ConfigError: the folder cannot be read or written, or already contains a certificate of a hub.
    """
    names: list[x509.GeneralName] = []
    for host in hosts:
        try:
            names.append(x509.IPAddress(ip_address(host)))
        except ValueError:
            names.append(x509.DNSName(host))
    both = [ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH]
    return _issue(folder, folder / HUB_FOLDER, HUB_FOLDER, HUB, both, names, days)


def issue_cell(folder: Path, cell: str, days: int) -> Path:
    """Issue the certificate of a cell. Returns its folder, which must be copied to the cell's computer.

    Raises:
        ConfigError: see `issue_hub`.
    """
    own = folder / CELLS / cell
    return _issue(folder, own, CELL, cell, [ExtendedKeyUsageOID.CLIENT_AUTH], [], days)


def cells_with_certificates(folder: Path) -> list[str]:
    """The names of the cells that have a certificate."""
    return sorted(path.parent.name for path in (folder / CELLS).glob(f"*/{CELL}.pem"))


def check_cell_folder(folder: Path) -> None:
    """Check the files in the folder of a cell's certificate.

    Raises:
        ConfigError: a file cannot be read, does not belong to the other files, or has expired.
    """
    authority = _read_certificate(folder / f"{AUTHORITY}.pem")
    certificate, key = _read_certificate(folder / f"{CELL}.pem"), _read_key(folder / f"{CELL}.key")
    if certificate.public_key() != key.public_key():
        raise ConfigError(f"{folder}: {CELL}.key is not the key of {CELL}.pem")
    try:
        certificate.verify_directly_issued_by(authority)
    except (InvalidSignature, ValueError, TypeError) as exc:
        raise ConfigError(f"{folder}: {CELL}.pem is not issued by {AUTHORITY}.pem") from exc
    if datetime.now(UTC) > certificate.not_valid_after_utc:
        raise ConfigError(f"{folder}: {CELL}.pem expired on {certificate.not_valid_after_utc:%Y-%m-%d}")


class Signer:
    """Signs the commands of a hub.

    Args:
        folder: folder of the fleet.

    Attributes:
        hosts: the names and addresses in the hub's certificate.

    Raises:
        ConfigError: the hub's certificate or key cannot be read.
    """

    def __init__(self, folder: Path) -> None:
        own = folder / HUB_FOLDER
        self._certificate = _read_certificate(own / f"{HUB_FOLDER}.pem")
        self._key = _read_key(own / f"{HUB_FOLDER}.key")
        if self._certificate.public_key() != self._key.public_key():
            raise ConfigError(f"{own}: {HUB_FOLDER}.key is not the key of {HUB_FOLDER}.pem")
        names = self._certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
        self.hosts = [str(each.value) for each in names]

    def signed(self, command: StrictModel) -> SignedCommand:
        """Sign a command or another message."""
        text = command.model_dump_json()
        signature = self._key.sign(text.encode(), ec.ECDSA(hashes.SHA256()))
        return SignedCommand(
            command=text,
            certificate=self._certificate.public_bytes(serialization.Encoding.PEM).decode(),
            signature=base64.b64encode(signature).decode(),
        )


class Verifier:
    """Checks, in a cell, that commands come from a hub of its fleet.

    Args:
        folder: the cell's certificate folder.

    Raises:
        ConfigError: the authority's certificate cannot be read.
    """

    def __init__(self, folder: Path) -> None:
        self._authority = _read_certificate(folder / f"{AUTHORITY}.pem")

    def command_of(self, content: bytes) -> FleetCommand:
        """The command in a message. See `read`."""
        return self.read(FleetCommand, content)

    def read(self, kind: type[Model], content: bytes) -> Model:
        """Check a signed message, and read its content.

        Raises:
            InputError: the content is not a signed command.
            PermissionDenied: no hub of this fleet has signed it.
        """
        signed = read(SignedCommand, content)
        try:
            certificate = x509.load_pem_x509_certificate(signed.certificate.encode())
            certificate.verify_directly_issued_by(self._authority)
            usage = certificate.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value
            key = certificate.public_key()
            if not isinstance(key, ec.EllipticCurvePublicKey):
                raise PermissionDenied(
                    "the hub's certificate is not valid: its key is not an elliptic-curve key"
                )
            key.verify(
                base64.b64decode(signed.signature, validate=True),
                signed.command.encode(),
                ec.ECDSA(hashes.SHA256()),
            )
        except InvalidSignature as exc:
            raise PermissionDenied("the command is not signed by a hub of this fleet") from exc
        except (ValueError, TypeError, x509.ExtensionNotFound) as exc:
            raise PermissionDenied(f"the hub's certificate is not valid: {exc}") from exc
        if ExtendedKeyUsageOID.SERVER_AUTH not in usage:
            raise PermissionDenied("the command is signed by a cell; only a hub may sign")
        now = datetime.now(UTC)
        if not certificate.not_valid_before_utc <= now <= certificate.not_valid_after_utc:
            raise PermissionDenied(
                f"the hub's certificate is valid until {certificate.not_valid_after_utc:%Y-%m-%d}; "
                "issue a new one, or check the clock of this computer"
            )
        return read(kind, signed.command.encode())


def _issue(
    folder: Path,
    own: Path,
    file: str,
    name: str,
    uses: list[x509.ObjectIdentifier],
    hosts: list[x509.GeneralName],
    days: int,
) -> Path:
    if (own / f"{file}.pem").exists():
        raise ConflictError(f"{own}: already contains a certificate; move it away to issue a new one")
    authority = _read_certificate(folder / f"{AUTHORITY}.pem")
    authority_key = _read_key(folder / f"{AUTHORITY}.key")
    key = ec.generate_private_key(CURVE)
    now = datetime.now(UTC)
    end = min(now + timedelta(days=days), authority.not_valid_after_utc)
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
    public = key.public_key()
    authority_id = x509.AuthorityKeyIdentifier.from_issuer_public_key(authority_key.public_key())
    builder = (
        x509.CertificateBuilder(authority.subject, subject, public, x509.random_serial_number())
        .not_valid_before(now - EARLIER)
        .not_valid_after(end)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(_usage(signs_certificates=False), critical=True)
        .add_extension(x509.ExtendedKeyUsage(uses), critical=False)
        .add_extension(authority_id, critical=False)
        .add_extension(x509.SubjectAlternativeName(hosts or [x509.DNSName(name)]), critical=False)
    )
    _write(own, file, builder.sign(authority_key, hashes.SHA256()), key)
    with contextlib.suppress(FileNotFoundError):
        (own / f"{AUTHORITY}.pem").unlink()
    _create(own / f"{AUTHORITY}.pem", authority.public_bytes(serialization.Encoding.PEM))
    return own


def _usage(*, signs_certificates: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=True,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        key_cert_sign=signs_certificates,
        crl_sign=signs_certificates,
        encipher_only=False,
        decipher_only=False,
    )


def _write(folder: Path, name: str, certificate: x509.Certificate, key: ec.EllipticCurvePrivateKey) -> None:
    """Write the key before the certificate, so that a certificate never exists without its key."""
    secret = key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    _create(folder / f"{name}.key", secret)
    _create(folder / f"{name}.pem", certificate.public_bytes(serialization.Encoding.PEM))


def _create(path: Path, content: bytes) -> None:
    """Create a file that only its owner can read."""
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
        with os.fdopen(descriptor, "wb") as file:
            file.write(content)
    except FileExistsError as exc:
        raise ConflictError(f"{path}: already exists; move it away") from exc
    except OSError as exc:
        raise ConfigError(f"{path}: cannot be written: {exc.strerror}") from exc


def _read_certificate(path: Path) -> x509.Certificate:
    with _naming(path):
        return x509.load_pem_x509_certificate(path.read_bytes())


def _read_key(path: Path) -> ec.EllipticCurvePrivateKey:
    with _naming(path):
        found = serialization.load_pem_private_key(path.read_bytes(), None)
    if not isinstance(found, ec.EllipticCurvePrivateKey):
        raise ConfigError(f"{path}: is not an elliptic-curve key; create one with cobot fleet certificate")
    return found


@contextlib.contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Context manager that converts errors about the certificate file to a ConfigError.

    Raises:
        ConfigError: the file cannot be read, or is invalid.
    """
    try:
        yield
    except OSError as exc:
        raise ConfigError(
            f"{path}: cannot be read: {exc.strerror}; create it with cobot fleet certificate"
        ) from exc
    except (ValueError, TypeError) as exc:
        raise ConfigError(f"{path}: is not valid: {exc}") from exc
