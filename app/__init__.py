"""The web service.

What checks and writes a model of pydantic is built when it is first used, not when its class is made: a
service starts with 400 classes, FastAPI's of OpenAPI among them, and most runs need a few. That is a third of
the time that its imports took; the first request to an endpoint takes some milliseconds instead.
"""

import warnings

from pydantic import BaseModel
from pydantic.warnings import UnsupportedFieldAttributeWarning

BaseModel.model_config["defer_build"] = True
# FastAPI silences it too, but only while a route is made.
warnings.simplefilter("ignore", UnsupportedFieldAttributeWarning)
