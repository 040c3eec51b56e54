"""A fuzzer over the whole OpenAPI schema: schemathesis, which nobody here has written.

It finds statuses that are not documented, answers that do not fit their schema, and server errors.
"""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

from running import Run

CHECKS = (
    "not_a_server_error",
    "status_code_conformance",
    "content_type_conformance",
    "response_schema_conformance",
    "response_headers_conformance",
)


def test_schemathesis_finds_no_server_error_and_no_undocumented_answer(shared: Run, tmp_path: Path) -> None:
    result = subprocess.run(
        [
            *(sys.executable, "-m", "schemathesis.cli", "run", f"{shared.url}/openapi.json"),
            *("--checks", ",".join(CHECKS)),
            *("--phases", "examples,coverage,fuzzing", "--max-examples", "25", "--seed", "8007"),
            *("--request-timeout", "30", "--no-color", "--workers", "2"),
        ],
        capture_output=True,
        text=True,
        timeout=280,
        check=False,
        cwd=tmp_path,  # where it leaves what it has found
    )
    assert result.returncode == 0, result.stdout[-6000:] + result.stderr[-2000:]
    assert re.search(r"\d+ passed", result.stdout)
