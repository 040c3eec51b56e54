"""The floor for HTTP: a FastAPI application with three trivial routes, served in the same way as cobot."""

from __future__ import annotations

import socket
import sys

import uvicorn
from fastapi import FastAPI, WebSocket, WebSocketDisconnect

from cobot.launch.process import Niceness, set_niceness

PAYLOAD = {
    "name": [f"joint{n}" for n in range(1, 8)],
    "position": [-0.00012345678901234, 0.5123456789012345, 0.0, -1.570123456789012, 0.0, 1.57, 0.0],
    "velocity": [1.2345678901234567e-05] * 7,
    "effort": [0.012345678901234567, -46.1234567890123, 0.0123, 21.812345678901234, 0.01, 0.4, 0.001],
}
app = FastAPI()


@app.get("/robot/joint_states")
async def joint_states() -> dict[str, list]:
    return PAYLOAD


@app.post("/stop")
async def stop() -> dict[str, bool]:
    return {"success": True}


@app.websocket("/echo")
async def echo(socket: WebSocket) -> None:
    await socket.accept()
    try:
        while True:
            await socket.send_bytes(await socket.receive_bytes())
    except WebSocketDisconnect:
        return


if __name__ == "__main__":
    set_niceness(Niceness.PROMPT, session=True)  # as the service is
    listening = socket.create_server(("127.0.0.1", 0))
    folder = sys.argv[1] if sys.argv[1:] else None  # of a certificate
    print(f"http{'s' if folder else ''}://127.0.0.1:{listening.getsockname()[1]}", flush=True)
    config = uvicorn.Config(
        app,
        loop="uvloop",
        http="httptools",
        access_log=False,
        log_level="error",
        ws_per_message_deflate=False,
        ssl_certfile=folder and f"{folder}/service.pem",
        ssl_keyfile=folder and f"{folder}/service.key",
    )
    uvicorn.Server(config).run(sockets=[listening])
