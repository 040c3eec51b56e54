"""Certificates for tests, made by openssl."""

from __future__ import annotations

import subprocess
from pathlib import Path


def certificate(folder: Path, name: str, passphrase: str = "") -> Path:
    """A self-signed FOLDER/NAME.pem with its key NAME.key, made out to somebody else than localhost."""
    key = ("-passout", f"pass:{passphrase}") if passphrase else ("-nodes",)
    subprocess.run(
        [
            *(
                "openssl",
                "req",
                "-x509",
                "-newkey",
                "ec",
                "-pkeyopt",
                "ec_paramgen_curve:P-256",
                "-days",
                "2",
            ),
            *(
                "-subj",
                "/CN=robot.example",
                "-keyout",
                folder / f"{name}.key",
                "-out",
                folder / f"{name}.pem",
            ),
            *key,
        ],
        check=True,
        capture_output=True,
    )
    return folder / f"{name}.pem"
