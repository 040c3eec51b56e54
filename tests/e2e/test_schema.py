"""A fuzzer over the whole OpenAPI schema: schemathesis, which nobody here has written.

It finds statuses that are not documented, answers that do not fit their schema, and server errors.
"""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import httpx
from running import WAIT_S, Run

CHECKS = (
    "not_a_server_error",
    "status_code_conformance",
    "content_type_conformance",
    "response_schema_conformance",
    "response_headers_conformance",
)


VENDOR_SERVICES = "/openapi/vendor.json"
CONTROL = r"/control$"
WAITING = ("Serial", "Socket")
"""Classes whose reads wait for their time to be up."""


def fuzzed(service: Run, folder: Path, *options: str, document: str = "/openapi.json") -> None:
    result = subprocess.run(
        [
            *(sys.executable, "-m", "schemathesis.cli", "run", f"{service.url}{document}"),
            *("--checks", ",".join(CHECKS), "--seed", "8007", "--request-timeout", "30", "--no-color"),
            *options,
        ],
        capture_output=True,
        text=True,
        timeout=280,
        check=False,
        cwd=folder,  # where it leaves what it has found
    )
    assert result.returncode == 0, result.stdout[-6000:] + result.stderr[-2000:]
    assert re.search(r"\d+ passed", result.stdout)


def test_schemathesis_finds_no_server_error_and_no_undocumented_answer(shared: Run, tmp_path: Path) -> None:
    phases = ("--phases", "examples,coverage,fuzzing", "--max-examples", "25", "--workers", "2")
    fuzzed(shared, tmp_path, *phases, "--exclude-path-regex", CONTROL)  # nothing would move with it


def test_schemathesis_finds_none_in_taking_the_control(shared: Run, tmp_path: Path) -> None:
    phases = ("--phases", "examples,coverage,fuzzing", "--max-examples", "25")
    try:
        fuzzed(shared, tmp_path, *phases, "--include-path-regex", CONTROL)
    finally:
        path = f"{shared.url}/robot/control"
        taken = httpx.post(path, json={"force": True}, timeout=WAIT_S).raise_for_status().json()
        httpx.delete(path, headers={"X-Control-Token": taken["token"]}).raise_for_status()


def test_schemathesis_finds_none_in_the_vendor_services_either(run: Run, tmp_path: Path) -> None:
    tags = [word for tag in WAITING for word in ("--exclude-tag", tag)]
    phases = ("--phases", "examples,fuzzing", "--max-examples", "3")
    fuzzed(run, tmp_path, *phases, *tags, document=VENDOR_SERVICES)
