"""An agent with a client of MCP before 2.0, in an environment of its own: tests/e2e/test_mcp1.py starts it.

    python mcp1_client.py URL|COMMAND... [[JOINTS, SPEED], ...]

tells what there is, plans each motion, runs the plan and tells how it went: each line that it prints is JSON.
"""

from __future__ import annotations

import asyncio
import json
import os
import sys
from contextlib import asynccontextmanager
from typing import Any

from mcp import ClientSession, StdioServerParameters
from mcp.client.stdio import stdio_client
from mcp.client.streamable_http import streamablehttp_client


@asynccontextmanager
async def connected(where: list[str]) -> Any:
    if where[0].startswith("http"):
        connection: Any = streamablehttp_client(where[0])
    else:
        program = StdioServerParameters(command=where[0], args=where[1:], env=dict(os.environ))
        connection = stdio_client(program)
    async with connection as (reading, writing, *_), ClientSession(reading, writing) as session:
        await session.initialize()
        yield session


async def main(where: list[str], motions: list[Any]) -> None:
    async with connected(where) as session:

        async def call(tool: str, **arguments: Any) -> Any:
            answer = await session.call_tool(tool, arguments)
            assert not answer.isError, answer.content[0].text
            return json.loads(answer.content[0].text)

        say(
            tools=[tool.name for tool in (await session.list_tools()).tools],
            prompts=[prompt.name for prompt in (await session.list_prompts()).prompts],
            manual=(await session.read_resource("cobot://manual")).contents[0].text,
        )
        for joints, speed in motions:
            plan = await call("plan_to_joints", joints=joints, speed=speed)
            say(**await call("execute", plan_id=plan["plan_id"]))


def say(**what: Any) -> None:
    print(json.dumps(what), flush=True)


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1:-1], json.loads(sys.argv[-1])))
