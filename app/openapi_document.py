"""`python -m app.openapi_document`: prints the OpenAPI document of a service with the default configuration.

It equals the `/openapi.json` of that service, except that a robot may have any name.
`packages/cobot-client-js` is generated from it and works with every service.
"""

from __future__ import annotations

import json

from app.api.documentation.openapi import BY_NAME
from app.main import create_app
from cobot.addresses import DEFAULT_URL
from cobot.config import load_settings


def openapi_document() -> str:
    """Return the OpenAPI document as JSON."""
    document = create_app(load_settings(None), None, DEFAULT_URL).openapi()
    for path, operations in document["paths"].items():
        if path.startswith(BY_NAME):
            for operation in operations.values():
                (robot,) = (
                    each
                    for each in operation["parameters"]
                    if each["in"] == "path" and each["name"] == "robot"
                )
                robot["schema"].pop("enum")
    return json.dumps(document)


if __name__ == "__main__":
    print(openapi_document())
