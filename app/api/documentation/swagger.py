"""Swagger's pages and sample files. /docs is the REST API, /docs/robots has the same endpoints with a robot's
name in the path, and /docs/vendor has the vendor services.

A single page would have 410 operations, which a browser takes seconds to draw. /openapi.json, for client
generators, covers the first two pages.
"""

from __future__ import annotations

import asyncio
import json
import threading
from collections.abc import Callable, Hashable
from typing import Any

from fastapi import FastAPI
from fastapi.openapi.docs import get_swagger_ui_html
from fastapi.responses import HTMLResponse, Response

from app.api.documentation.openapi import of_any_robot, of_the_default_robot
from app.api.documentation.samples import SAMPLES, SAMPLES_PATH
from cobot.addresses import VERSION
from cobot.errors import NotFoundError
from cobot.strict import unknown_key

STATIC = "/static-offline-docs"
SCHEMA = "/openapi/robot.json"
ROBOTS_PAGE, ROBOTS_SCHEMA = "/docs/robots", "/openapi/robots.json"
VENDOR_PAGE, VENDOR_SCHEMA = "/docs/vendor", "/openapi/vendor.json"
PARAMETERS = {
    "displayRequestDuration": True,
    "tryItOutEnabled": True,
    "defaultModelsExpandDepth": -1,  # no list of models at the end; each endpoint shows its own
    "docExpansion": "none",
}
SERVERS: list[dict[str, Any]] = [
    {"url": VERSION, "description": "This version of the API."},
    {"url": "/", "description": "The same API without a version, for older clients."},
]
"""The two base URLs of the API. Each path is listed once and exists below both. Generated clients use the
first one.
"""
TAGS = [
    {"name": "robot", "description": "State, motions, and who controls the arm."},
    {"name": "gripper", "description": "The gripper: its state and its commands."},
    {"name": "force", "description": "Motions that push, and the zero of the measured force."},
    {"name": "plans", "description": "Plans: motions that are planned now and executed later."},
    {
        "name": "scene",
        "description": "Solids around the arm, attached objects, named frames, and the look of the robot.",
    },
    {"name": "cell", "description": "The parts and switches of a simulated cell."},
    {"name": "trajectory", "description": "Timed joint trajectories."},
    {"name": "recordings", "description": "What the robot did, as MCAP files."},
    {"name": "sequences", "description": "Sequences of motions, and Lua programs."},
    {
        "name": "studies",
        "description": "Questions that need thousands of computations, such as maps of the reach.",
    },
    {"name": "events", "description": "Events, as they happen."},
    {
        "name": "jobs",
        "description": "Progress, cancel, pause and resume of motions; the speed override.",
    },
    {"name": "common", "description": "Stop, and health."},
    {
        "name": "operations",
        "description": "For administrators: liveness, metrics, reload, tokens and audit log.",
    },
    {"name": "robots", "description": "The list of robots, and the endpoints of a robot by its name."},
]
"""The groups, in the order in which Swagger shows them. Swagger opens the first one."""


NAVIGATION = """<nav style="font: 1rem sans-serif; padding: 0.75rem 1.25rem">
<a href="/">Panel</a> · <a href="/manual/">Manual</a> · <a href="/docs">REST API</a> ·
<a href="/docs/robots">REST API by robot</a> · <a href="/docs/vendor">Vendor services</a> ·
<a href="/redoc">Reference (ReDoc)</a>
</nav>"""
"""Links at the top of the page. They appear before Swagger UI, for which a browser needs almost a second."""

_turn = threading.Lock()
"""Lock that is held while a document is made, because the documents share parts."""


class _Document:
    """An OpenAPI document, as the bytes that are sent.

    It is created in a thread on the first request, which takes a third of a second.

    Args:
        schema: returns the document.
        version: returns the version; if it changes, the document is made again.
    """

    def __init__(self, schema: Callable[[], dict[str, Any]], version: Callable[[], Hashable]) -> None:
        self._schema = schema
        self._version = version
        self._made: tuple[Hashable, bytes] | None = None

    async def answer(self) -> Response:
        made = self._made
        if made is None or made[0] != self._version():
            made = await asyncio.to_thread(self._make)
        return Response(made[1], media_type="application/json")

    def _make(self) -> tuple[Hashable, bytes]:
        with _turn:
            version = self._version()
            if self._made is None or self._made[0] != version:
                text = json.dumps(self._schema(), ensure_ascii=False, separators=(",", ":"))
                self._made = version, text.encode()
            return self._made


def install(app: FastAPI, version: Callable[[], Hashable]) -> None:
    """Serve the pages of the REST API, its OpenAPI documents, and the sample files.

    Args:
        version: returns the version of the documents, see `app.api.documentation.openapi.version`.
    """
    # FastAPI's own route would serialize it again for each request.
    app.router.routes[:] = [
        each for each in app.router.routes if getattr(each, "path", "") != app.openapi_url
    ]
    # A function, as `app.openapi` is replaced later.
    _serve(app, str(app.openapi_url), _Document(lambda: app.openapi(), version))
    _serve(app, SCHEMA, _Document(lambda: of_the_default_robot(app.openapi()), version))
    _serve(app, ROBOTS_SCHEMA, _Document(lambda: of_any_robot(app.openapi()), version))

    @app.get("/docs", include_in_schema=False)
    async def docs() -> HTMLResponse:
        return _page(f"{app.title} - Swagger UI", SCHEMA, PARAMETERS, first=TAGS[0]["name"])

    @app.get(ROBOTS_PAGE, include_in_schema=False)
    async def robots_docs() -> HTMLResponse:
        return _page(f"{app.title}: REST API by robot - Swagger UI", ROBOTS_SCHEMA, PARAMETERS)

    @app.get(f"{SAMPLES_PATH}/{{name}}", include_in_schema=False)
    async def sample(name: str) -> Response:
        if name not in SAMPLES:
            raise NotFoundError(unknown_key(name, list(SAMPLES), "sample"))
        kind, text = SAMPLES[name]
        return Response(
            text, media_type=kind, headers={"Content-Disposition": f'attachment; filename="{name}"'}
        )


def install_vendor(app: FastAPI, schema: Callable[[], dict[str, Any]]) -> None:
    """Serve the page of the vendor services.

    Args:
        schema: returns their OpenAPI document, which is made once.
    """
    _serve(app, VENDOR_SCHEMA, _Document(schema, lambda: None))

    @app.get(VENDOR_PAGE, include_in_schema=False)
    async def vendor_docs() -> HTMLResponse:
        return _page(f"{app.title}: vendor services - Swagger UI", VENDOR_SCHEMA, PARAMETERS)


def _serve(app: FastAPI, path: str, document: _Document) -> None:
    @app.get(path, include_in_schema=False)
    async def schema() -> Response:
        return await document.answer()


def _page(title: str, schema: str, parameters: dict[str, Any], first: str = "") -> HTMLResponse:
    """Create a Swagger UI page that is served entirely by this service.

    Args:
        first: the group that is shown open; "" if all groups are closed.
    """
    page = get_swagger_ui_html(
        openapi_url=schema,
        title=title,
        swagger_js_url=f"{STATIC}/swagger-ui-bundle.js",
        swagger_css_url=f"{STATIC}/swagger-ui.css",
        swagger_favicon_url=f"{STATIC}/favicon.png",
        swagger_ui_parameters=parameters,
    )
    text = bytes(page.body).decode().replace("<body>", f"<body>\n{NAVIGATION}", 1)
    if first:
        # Swagger UI can show all groups open or none; FastAPI writes its settings as JSON, without functions.
        begin = "SwaggerUIBundle({"
        show = f'onComplete: () => ui.layoutActions.show(["operations-tag", {json.dumps(first)}], true),'
        text = text.replace(begin, f"{begin}\n        {show}", 1)
    return HTMLResponse(text)
