"""Many requests at the same time, from a process of their own, so that they delay nothing in the test.

    parallel_requests.py URL CA_FILE REQUESTS CONNECTIONS

It prints a line when the first answer has come, and in the end how many answers had which status; 0 for none.
"""

from __future__ import annotations

import asyncio
import json
import ssl
import sys
from collections import Counter

import httpx


async def ask(url: str, certificate: str, requests: int, connections: int) -> Counter[int]:
    limits = httpx.Limits(max_connections=connections)
    trusted = ssl.create_default_context(cafile=certificate)
    codes: Counter[int] = Counter()
    places = asyncio.Semaphore(connections)  # in the pool of httpx, a long wait for a place is an error

    async def one(client: httpx.AsyncClient) -> None:
        async with places:
            try:
                code = (await client.get(url)).status_code
            except httpx.HTTPError:
                code = 0
        if not codes:
            print("begun", flush=True)
        codes[code] += 1

    async with httpx.AsyncClient(limits=limits, verify=trusted, timeout=60.0) as client:
        await asyncio.gather(*(one(client) for _ in range(requests)))
    return codes


if __name__ == "__main__":
    _, url, certificate, requests, connections = sys.argv
    print(json.dumps(asyncio.run(ask(url, certificate, int(requests), int(connections)))))
