"""A C# client that is generated from the OpenAPI document moves the simulated arm.

Oracles: NSwag, which generates it; Mono's compiler and runtime; REST, which has the joints.
"""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from cobot_run import Run
from folders import ROOT

from app.openapi_document import openapi_document

TOOLS = ROOT / "packages" / "cobot-client-js" / "node_modules" / "nswag" / "bin" / "binaries" / "Win"
LIBRARIES = (
    "System.Net.Http.dll",
    "System.ComponentModel.DataAnnotations.dll",
    "System.Runtime.Serialization.dll",
)
GOAL = [0.3, 0.5, 0.0, -1.57, 0.0, 1.57, 0.0]
PROGRAM = """
using System;
using System.Net.Http;
using System.Threading.Tasks;
using Cobot;

static class Program
{
    static void Main(string[] words)
    {
        Use(new CobotClient(new HttpClient()) { BaseUrl = words[0] }).Wait();
    }

    static async Task Use(CobotClient robot)
    {
        var goal = new MoveJoints { Joints = new[] { 0.3, 0.5, 0.0, -1.57, 0.0, 1.57, 0.0 }, Speed = 0.5 };
        var moved = await robot.Move_jointsAsync(null, null, null, null, null, null, null, goal);
        Console.WriteLine(moved.Success);
        Console.WriteLine((await robot.Joint_statesAsync()).Position.Count);
        try
        {
            goal.Joints = new[] { 9.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0 };
            await robot.Move_jointsAsync(null, null, null, null, null, null, null, goal);
        }
        catch (ApiException refused)
        {
            Console.WriteLine(refused.StatusCode);
        }
        Console.WriteLine((await robot.StopAsync(null, null, null)).At_rest);
    }
}
"""

pytestmark = [
    pytest.mark.thorough,
    pytest.mark.skipif(
        not TOOLS.is_dir() or shutil.which("mcs") is None or shutil.which("mono") is None,
        reason="Mono (mono-mcs, mono-runtime) is not installed, or `make setup-dev` has not run",
    ),
]


def call(folder: Path, *command: str) -> str:
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_a_generated_client_is_compiled_moves_and_is_told_what_is_wrong(shared: Run, tmp_path: Path) -> None:
    (tmp_path / "service.json").write_text(openapi_document(), encoding="utf-8")
    call(
        tmp_path,
        "mono",
        str(TOOLS / "NSwag.exe"),
        "openapi2csclient",
        "/input:service.json",
        "/output:Client.cs",
        "/namespace:Cobot",
        "/classname:CobotClient",
        "/operationGenerationMode:SingleClientFromOperationId",
        "/generateOptionalPropertiesAsNullable:true",
    )
    (tmp_path / "Program.cs").write_text(PROGRAM, encoding="utf-8")
    newtonsoft = "Newtonsoft.Json.dll"
    shutil.copy(TOOLS / newtonsoft, tmp_path)
    references = [f"-r:{name}" for name in (newtonsoft, *LIBRARIES)]
    call(tmp_path, "mcs", "-langversion:latest", "-out:program.exe", *references, "Client.cs", "Program.cs")
    said = call(tmp_path, "mono", "program.exe", shared.url).split()
    assert said == ["True", "7", "422", "True"]
    np.testing.assert_allclose(shared.joints(), GOAL, atol=5e-3)
    assert json.loads((tmp_path / "service.json").read_text(encoding="utf-8"))["openapi"].startswith("3.1")
