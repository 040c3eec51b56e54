"""`cobot mcp` at a running service. The oracle is the official client of MCP over stdio."""

from __future__ import annotations

import asyncio
import json
import os
import sys

import httpx
import numpy as np
from cobot_run import Run
from mcp.client.client import Client
from mcp.client.stdio import StdioServerParameters

THERE = [0.2, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0]


def test_an_agent_over_stdio_plans_and_is_told_that_it_may_not_move(http: httpx.Client, shared: Run) -> None:
    async def tour() -> tuple[list[float], str]:
        program = StdioServerParameters(
            command=sys.executable, args=["-m", "cobot", "mcp", "--url", shared.url], env=dict(os.environ)
        )
        async with Client(program) as client:
            state = json.loads((await client.call_tool("get_state", {})).content[0].text)  # type: ignore[union-attr]
            plan = json.loads((await client.call_tool("plan_to_joints", {"joints": THERE})).content[0].text)  # type: ignore[union-attr]
            refused = await client.call_tool("execute", {"plan_id": plan["plan_id"]})
            assert refused.is_error
            return state["joints"]["position"], refused.content[0].text  # type: ignore[union-attr]

    position, refusal = asyncio.run(tour())
    np.testing.assert_allclose(position, http.get("/robot/joint_states").json()["position"], atol=1e-3)
    assert "mcp.execution is off" in refusal
