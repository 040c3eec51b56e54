"""The operator panel at `/`: static files, and three.js from an installed package.

The panel consists of plain ES modules, without a build. The modules of three.js are part of the package
ifc-console-viewer and are served from its folder. The package itself is not imported.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from fastapi import FastAPI
from fastapi.responses import FileResponse, RedirectResponse, Response
from starlette.staticfiles import StaticFiles
from starlette.types import Message, Receive, Scope, Send

from app.api.roles import PANEL, PANEL_LUA, PANEL_PLANNERS, THREE
from cobot.errors import NotFoundError
from cobot.lua_functions import FUNCTIONS
from cobot.motions.bodies import JointMotion
from cobot.motions.planners import GOAL_ALONE, PLANNERS, Way

SITE = Path(__file__).parent / "site"
THREE_PACKAGE = "ifc_console_viewer"
THREE_FOLDER = Path("static", "vendor")
THREE_MODULES = ("three.core.min.js", "three.module.min.js", "OrbitControls.js")
"""Names of the three.js files that the panel uses. The files import each other under these names."""


def page_headers(scripts: Sequence[str] = (), styles: Sequence[str] = ()) -> dict[str, str]:
    """Return the headers for static pages.

    Args:
        scripts: additional allowed sources of scripts, in the form of a Content-Security-Policy.
        styles: additional allowed sources of styles.
    """
    policy = (
        "default-src 'none'",
        " ".join(("script-src 'self'", *scripts)),
        " ".join(("style-src 'self'", *styles)),
        "img-src 'self' data:",
        "connect-src 'self'",
        "base-uri 'none'",
        "form-action 'none'",
        "frame-ancestors 'none'",
    )
    return {
        "Content-Security-Policy": "; ".join(policy),
        "X-Frame-Options": "DENY",
        "X-Content-Type-Options": "nosniff",
        "Referrer-Policy": "no-referrer",
        "Cache-Control": "no-cache",  # so that browsers check whether their copy is still current
    }


HEADERS = page_headers()


class Site(StaticFiles):
    """Static files that are sent with additional headers.

    Args:
        options: see `StaticFiles`.
    """

    def __init__(self, headers: Mapping[str, str], **options: Any) -> None:
        super().__init__(**options)
        self._headers = [(name.lower().encode(), value.encode()) for name, value in headers.items()]

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                message = {**message, "headers": [*message.get("headers", ()), *self._headers]}
            await send(message)

        await super().__call__(scope, receive, send_with_headers)


def find_three(name: str) -> Path:
    """Return the path of a three.js module.

    Args:
        name: one of `THREE_MODULES`.

    Raises:
        NotFoundError: the panel does not use a module with this name, or the package is not installed or has
            no such file.
    """
    if name not in THREE_MODULES:
        raise NotFoundError(f"there is no {name!r} here; the modules are {', '.join(THREE_MODULES)}")
    spec = find_spec(THREE_PACKAGE)
    for folder in (spec and spec.submodule_search_locations) or ():
        file = Path(folder) / THREE_FOLDER / name
        if file.is_file():
            return file
    raise NotFoundError(
        f"three.js is missing: the package {THREE_PACKAGE.replace('_', '-')}, which contains {name}, is not "
        "installed. Install it with pip. The panel works without the picture of the arm"
    )


def planners_module() -> str:
    """Create the JavaScript module that lists the planners that need only a goal, and the default planner.

    `pose` is true if the goal is a pose, and false if it is joint angles.
    """
    table = {
        name: {"pose": PLANNERS[name].way is Way.PATH, "summary": PLANNERS[name].summary}
        for name in GOAL_ALONE
    }
    default = JointMotion.model_fields["planner"].default
    return f"export const PLANNERS = {json.dumps(table)};\nexport const DEFAULT = {json.dumps(default)};\n"


def install(app: FastAPI) -> None:
    """Serve the panel."""

    @app.get("/", include_in_schema=False)
    async def panel() -> FileResponse:
        return FileResponse(SITE / "index.html", headers=HEADERS)

    @app.get(PANEL, include_in_schema=False)
    @app.get(f"{PANEL}/", include_in_schema=False)
    async def by_name() -> RedirectResponse:  # the address that people are likely to try first
        return RedirectResponse("/")

    @app.get(THREE, include_in_schema=False)
    async def three(name: str) -> FileResponse:
        return FileResponse(find_three(name), media_type="text/javascript", headers=HEADERS)

    @app.get(PANEL_PLANNERS, include_in_schema=False)
    async def planners() -> Response:
        return Response(planners_module(), media_type="text/javascript", headers=HEADERS)

    @app.get(PANEL_LUA, include_in_schema=False)
    async def lua_functions() -> Response:
        text = f"export const FUNCTIONS = {json.dumps(FUNCTIONS)};\n"
        return Response(text, media_type="text/javascript", headers=HEADERS)

    app.mount(PANEL, Site(HEADERS, directory=SITE))
