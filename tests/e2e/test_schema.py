"""A fuzzer over the whole OpenAPI schema: schemathesis, which nobody here has written.

It finds statuses that are not documented, answers that do not fit their schema, and server errors.
`COBOT_TEST_SEED` has it ask for other things.
"""

from __future__ import annotations

import contextlib
import os
import re
import subprocess
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import httpx
import pytest
from cobot_run import HELPER_ENVIRONMENT, WAIT_S, Run, answering
from folders import ROOT

from cobot.access.roles import Role
from cobot.access.tokens import TokenFile

CHECKS = (
    "not_a_server_error",
    "status_code_conformance",
    "content_type_conformance",
    "response_schema_conformance",
    "response_headers_conformance",
    "unsupported_method",
    "allow_header_conformance",
)
ALL_CHECKS = ",".join(CHECKS)
SEED = os.environ.get("COBOT_TEST_SEED", "8007")
VENDOR_SERVICES = "/openapi/vendor.json"
CONTROL = r"control$"
SPEED = r"speed_override$"
"""With an override of 0 no motion would ever end."""
READY = r"health/ready$"
"""Its 503 is what it is there for: a planning process that a stop has ended is replaced."""
NOT_HERE = r"events$|/gripper|^/studies$"
"""An answer without an end: tests/app/api/routers/test_events.py has it. This robot has no gripper, so
the answers would be 501: tests/app/api/routers/test_gripper.py has those of a gripper. A process of its own
judges each study, and a hundred of them take a minute: only those of a robot that is named are asked for.
"""
BY_NAME = r"^/robots/\{robot\}/"
"""The same routes once more, of a robot that is named."""
LOOK_EVERY_S = 0.1
PLANNED = re.compile(r"\(for [\d.]+ s\)$")
"""How the name of a motion ends that has no number yet."""
FORCE = "/force/"
"""Motions with force never get a number, and take as long as on a real robot."""
LIMIT_S = 1800
pytestmark = pytest.mark.timeout(2 * LIMIT_S)
WAITING = ("Serial", "Socket")
"""Classes whose reads wait for their time to be up."""
KEPT = str(ROOT / ".hypothesis")
"""Which characters UTF-8 has takes hypothesis three seconds to find out: it is kept here."""
HOOKS = "schema_hooks"
IMPATIENT = "timeout_s: 0.2, explain_s: 0.1"
UNHURRIED = (
    f", hang_to_restart_s: {WAIT_S}"
    f", limits: {{header_timeout_s: {WAIT_S}, body_timeout_s: {WAIT_S}, idle_timeout_s: {2 * WAIT_S}}}"
)
"""A computer so busy that the fuzzer, or the service, does not come to run for seconds is not its fault."""


@pytest.fixture(scope="module")
def restless(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Run]:
    """A service that gives up plans soon: what is found out here is how it answers, not how it plans."""
    folder = tmp_path_factory.mktemp("fuzzed")
    with answering(Run(folder, planning=IMPATIENT, web=UNHURRIED)) as started:
        yield started


@contextmanager
def stopped_again_and_again(service: Run) -> Iterator[None]:
    """A motion that the fuzzer finds may take hours, and while it lasts others are only refused.

    So may a recording, of more cycles than there are in real time: its end waits for what is written still.
    What is still being planned is let be: a stop would have the planning process replaced.
    """
    ended = threading.Event()

    def stop() -> None:
        with httpx.Client(base_url=service.url, timeout=WAIT_S, **service.asking) as client:
            while not ended.wait(LOOK_EVERY_S):
                moving = client.get("/robot/control").raise_for_status().json()["what"]
                if moving is not None and (FORCE in moving or not PLANNED.search(moving)):
                    client.post("/stop").raise_for_status()
            client.post("/stop").raise_for_status()

    def stop_recordings() -> None:
        with httpx.Client(base_url=service.url, timeout=WAIT_S, **service.asking) as client:
            while not ended.wait(LOOK_EVERY_S):
                with contextlib.suppress(httpx.TransportError):
                    client.post("/recordings", json={"action": "stop"})  # It is refused while there is none.

    with ThreadPoolExecutor(2) as pool:
        stopped, _ = pool.submit(stop), pool.submit(stop_recordings)
        try:
            yield
        finally:
            ended.set()
            stopped.result()


def fuzzed(service: Run, folder: Path, *options: str, document: str = "/openapi.json") -> str:
    """What it has said of what it has done; it finds nothing."""
    command = [
        *(sys.executable, "-m", "schemathesis.cli", "run", f"{service.url}{document}"),
        *("--checks", ALL_CHECKS, "--seed", SEED, "--request-timeout", str(WAIT_S), "--no-color"),
        *("--generation-database", "none", "--suppress-health-check", "too_slow"),
        *options,
    ]
    # It waits for the document for 10 s, whatever it is told; the service keeps what it has once made.
    httpx.get(f"{service.url}{document}", timeout=WAIT_S).raise_for_status()
    with stopped_again_and_again(service):
        # The folder is where it leaves what it has found.
        result = subprocess.run(
            command,
            capture_output=True,
            text=True,
            timeout=LIMIT_S,
            check=False,
            cwd=folder,
            env=HELPER_ENVIRONMENT | {"HYPOTHESIS_STORAGE_DIRECTORY": KEPT, "SCHEMATHESIS_HOOKS": HOOKS},
        )
    # What it has put there would be in the way of the tests that follow.
    with httpx.Client(base_url=service.url, timeout=WAIT_S, **service.asking) as client:
        for path in ("/scene", "/robot/tool"):
            client.post(path, json={"clear": True})
        client.post("/robot/speed_override", json={"fraction": 1.0})  # at 0 nothing would come to its end
        for each in client.get("/robot/positions").raise_for_status().json():
            if each["taught"]:
                client.delete(f"/robot/positions/{each['name']}")
        for each in client.get("/programs").raise_for_status().json():
            client.delete(f"/programs/{each['id']}")
        for each in client.get("/studies").raise_for_status().json()["studies"]:
            client.post(f"/jobs/{each['job']}/cancel")
            client.delete(f"/studies/{each['id']}")
    found = result.stdout[max(0, result.stdout.find(" FAILURES ")) :]
    assert result.returncode == 0, found[:6000] + result.stderr[-2000:]
    assert re.search(r"\d+ passed", result.stdout)
    return result.stdout


@pytest.mark.thorough
def test_schemathesis_finds_no_server_error_and_no_undocumented_answer(restless: Run, tmp_path: Path) -> None:
    phases = ("--phases", "examples,coverage,fuzzing", "--max-examples", "4")
    # Nothing would move with the control taken.
    fuzzed(
        restless, tmp_path, *phases, "--exclude-path-regex", f"{CONTROL}|{SPEED}|{READY}|{NOT_HERE}|{BY_NAME}"
    )


@pytest.mark.thorough
def test_schemathesis_finds_none_with_the_robot_named(restless: Run, tmp_path: Path) -> None:
    phases = ("--phases", "fuzzing", "--max-examples", "1")
    paths = ("--include-path-regex", BY_NAME, "--exclude-path-regex", f"{CONTROL}|{SPEED}|{READY}|{NOT_HERE}")
    fuzzed(restless, tmp_path, *phases, *paths)


def test_schemathesis_finds_none_in_taking_the_control_or_the_speed(restless: Run, tmp_path: Path) -> None:
    phases = ("--phases", "examples,coverage,fuzzing", "--max-examples", "10")
    try:
        fuzzed(restless, tmp_path, *phases, "--include-path-regex", f"{CONTROL}|{SPEED}")
    finally:
        path = f"{restless.url}/robot/control"
        taken = httpx.post(path, json={"force": True}, timeout=WAIT_S).raise_for_status().json()
        httpx.delete(path, headers={"X-Control-Token": taken["token"]}).raise_for_status()
        httpx.post(f"{restless.url}/robot/speed_override", json={"fraction": 1.0}).raise_for_status()


@pytest.mark.thorough
def test_schemathesis_finds_none_in_the_vendor_services_either(restless: Run, tmp_path: Path) -> None:
    tags = [word for tag in WAITING for word in ("--exclude-tag", tag)]
    phases = ("--phases", "fuzzing", "--max-examples", "2")
    fuzzed(restless, tmp_path, *phases, *tags, document=VENDOR_SERVICES)


@pytest.fixture(scope="module")
def locked(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Run, dict[Role, str]]]:
    """A service that asks for tokens, and those of an observer and an administrator."""
    folder = tmp_path_factory.mktemp("locked")
    tokens = TokenFile(folder / "tokens.json")
    shown = {role: f"Bearer {tokens.create(role.name, role)}" for role in (Role.OBSERVER, Role.ADMIN)}
    web = f", authentication: required, tokens: tokens.json{UNHURRIED}"
    asking = {"headers": {"Authorization": shown[Role.ADMIN]}}
    with answering(Run(folder, web=web, planning=IMPATIENT, asking=asking)) as run:
        yield run, shown


@pytest.mark.thorough
@pytest.mark.parametrize("role", [None, Role.OBSERVER], ids=["no token", "an observer's"])
def test_schemathesis_finds_no_way_around_the_tokens(
    locked: tuple[Run, dict[Role, str]], tmp_path: Path, role: Role | None
) -> None:
    """It leaves tokens out, and makes them up: `ignored_auth` is that an answer is given all the same."""
    service, tokens = locked
    before = service.joints()
    phases = ("--phases", "examples,fuzzing", "--max-examples", "2")
    checks = ("--checks", f"{ALL_CHECKS},ignored_auth")
    token = ("--header", f"Authorization: {tokens[role]}") if role else ()
    paths = ("--exclude-path-regex", f"{READY}|{NOT_HERE}|{BY_NAME}")
    fuzzed(service, tmp_path, *phases, *checks, *token, *paths)
    assert service.joints() == pytest.approx(before, abs=0.01)


@pytest.mark.thorough
@pytest.mark.parametrize("role", [None, Role.ADMIN], ids=["no token is asked for", "an administrator's"])
def test_schemathesis_finds_none_in_what_goes_on_from_answers(
    request: pytest.FixtureRequest, tmp_path: Path, role: Role | None
) -> None:
    """It makes up scenarios of the links: plans that it runs, jobs that it cancels, what it has removed."""
    phases = ("--phases", "stateful", "--max-examples", "5")
    checks = ("--checks", f"{ALL_CHECKS},use_after_free,ensure_resource_availability")
    paths = ("--exclude-path-regex", f"{CONTROL}|{SPEED}|{READY}|{NOT_HERE}|{BY_NAME}")
    if role is None:
        said = fuzzed(request.getfixturevalue("restless"), tmp_path, *phases, *checks, *paths)
    else:
        service, tokens = request.getfixturevalue("locked")
        token = ("--header", f"Authorization: {tokens[role]}")
        said = fuzzed(service, tmp_path, *phases, *checks, *token, *paths)
    for done in (r"Scenarios: +[1-9]", r"API Links: +[1-9]\d* covered"):
        assert re.search(done, said), said
