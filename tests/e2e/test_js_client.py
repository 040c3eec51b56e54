"""The package @cobot/client: built, compiled with and run by Node.js. Oracles: tsc and Node.js."""

from __future__ import annotations

import json
import shutil
import socket
import subprocess
import tarfile
from pathlib import Path

import pytest
from cobot_run import Run
from folders import ROOT

from app.openapi_document import openapi_document
from cobot.client import Client

PACKAGE = ROOT / "packages" / "cobot-client-js"
MODULES = PACKAGE / "node_modules"
LENT = ("openapi-fetch", "openapi-typescript-helpers", "typescript")
COMPILER = {
    "compilerOptions": {
        "strict": True,
        "module": "nodenext",
        "target": "es2022",
        "lib": ["es2022", "dom"],
        "types": [],
    },
    "files": ["use.ts"],
}
USE = """
import { connect, CobotError } from "@cobot/client";
const [url = "", nobody = ""] = (globalThis as any).process.argv.slice(2);
const robot = connect(url + "/", { name: "Zoë" });
async function codeOf(work: Promise<unknown>): Promise<unknown> {
  try {
    await work;
  } catch (error) {
    if (error instanceof CobotError) return [error.code, error.status, error.message];
    return (error as Error).name;
  }
  return null;
}
const joints = [0.3, 0.5, 0, -1.57, 0, 1.57, 0];
const moved = await robot.POST("/robot/move/joints", { body: { joints, speed: 0.5 } });
if (moved.data && "success" in moved.data) moved.data.code satisfies string | null | undefined;
const state = await robot.GET("/robot/joint_states");
const plan = await robot.POST("/robot/plan/named", { body: { name: "home" } });
const path = { plan: plan.data?.plan_id ?? "" };
await robot.POST("/robot/plans/{plan}/execute", { params: { path } });
const far = { points: [{ positions: joints, time_from_start: 2 }], move_to_start: true };
const name = (await robot.GET("/robots")).data?.[0]?.name ?? "";
const begun = new AbortController();
const long = robot.POST("/robot/move/joints", {
  body: { joints: [1.5, 0.5, 0, -1.57, 0, 1.57, 0], speed: 0.05 },
  signal: begun.signal,
});
const aborted = codeOf(long);
begun.abort();
console.log(JSON.stringify({
  moved: moved.data,
  position: state.data?.position,
  aborted: await aborted,
  stopped: (await robot.POST("/stop")).response.status,
  sent: (await robot.POST("/trajectory/send", { body: far })).response.status,
  limit: await codeOf(robot.POST("/robot/move/joints", { body: { joints: [9, 0, 0, 0, 0, 0, 0] } })),
  unknown: await codeOf(robot.GET("/jobs/{job}", { params: { path: { job: "none" } } })),
  again: (await robot.POST("/stop")).response.status,
  named: await codeOf(
    robot.POST("/robots/{robot}/move/named", { params: { path: { robot: name } }, body: { name: "home" } }),
  ),
  nobody: await codeOf(connect(nobody).GET("/health")),
}));
"""
WRONG = """
import { connect } from "@cobot/client";
await connect("http://localhost:8007").POST("/robot/move/named", { body: { speed: 0.5 } });
"""

pytestmark = [
    pytest.mark.thorough,
    pytest.mark.skipif(
        not MODULES.is_dir() or shutil.which("npm") is None,
        reason="Node.js with npm is not installed, or `make setup-dev` has not run",
    ),
]


def call(folder: Path, *command: str) -> str:
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def tarball(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("js")
    build = folder / "build"
    shutil.copytree(PACKAGE, build, ignore=shutil.ignore_patterns("node_modules", "dist"))
    (build / "node_modules").symlink_to(MODULES)
    (build / "service.json").write_text(openapi_document(), encoding="utf-8")
    call(build, "npm", "run", "build", "--silent")
    call(build, "npm", "pack", "--silent", "--pack-destination", str(folder))
    (found,) = folder.glob("*.tgz")
    return found


@pytest.fixture(scope="module")
def project(tarball: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A user's project, which has the package and what it depends on."""
    folder = tmp_path_factory.mktemp("project")
    package = folder / "node_modules" / "@cobot" / "client"
    package.parent.mkdir(parents=True)
    with tarfile.open(tarball) as archive:
        archive.extractall(folder, filter="data")
    (folder / "package").rename(package)
    for name in LENT:
        (folder / "node_modules" / name).symlink_to(MODULES / name)
    (folder / "package.json").write_text('{"type": "module"}')
    (folder / "tsconfig.json").write_text(json.dumps(COMPILER))
    return folder


def compile_program(project: Path, program: str) -> str:
    (project / "use.ts").write_text(program)
    tsc = ("node", "node_modules/typescript/bin/tsc", "-p", ".")
    done = subprocess.run(tsc, cwd=project, capture_output=True, text=True, timeout=300, check=False)
    return done.stdout


def test_the_package_has_the_version_of_cobot_and_nothing_but_its_library(tarball: Path) -> None:
    version = json.loads((PACKAGE / "package.json").read_text())["version"]
    assert f'\nversion = "{version}"\n' in (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    with tarfile.open(tarball) as archive:
        names = {name.removeprefix("package/") for name in archive.getnames()}
    library = {f"dist/{name}" for name in ("index.js", "index.d.ts", "service.d.ts")}
    assert names == {"package.json", "README.md", *library}


def test_a_body_without_a_required_field_does_not_compile(project: Path) -> None:
    assert "Property 'name' is missing" in compile_program(project, WRONG)


def test_a_program_moves_stops_and_catches_errors(project: Path, shared: Run) -> None:
    assert compile_program(project, USE) == ""
    with socket.create_server(("127.0.0.1", 0)) as taken:
        nobody = f"http://127.0.0.1:{taken.getsockname()[1]}"
    said = json.loads(call(project, "node", "use.js", shared.url, nobody))
    assert said["moved"]["success"]
    assert said["position"][0] == pytest.approx(0.3, abs=1e-3)
    assert said["aborted"] == "AbortError"
    assert (said["stopped"], said["sent"], said["again"]) == (200, 200, 200)
    assert said["limit"][:2] == ["limit", 422]
    assert "joint1 is 9 rad" in said["limit"][2]
    assert said["unknown"][:2] == ["not_found", 404]
    assert said["named"] is None
    assert said["nobody"][:2] == ["unavailable", 0]
    assert f"{nobody} does not answer" in said["nobody"][2]
    assert "ECONNREFUSED" in said["nobody"][2]
    with Client(shared.url) as client:
        owners = {job["owner"] for job in client.jobs()}
    assert any("Zoë" in owner for owner in owners)
