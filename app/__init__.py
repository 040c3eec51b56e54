"""The web service.

The validator and the serializer of a pydantic model are built when the model is first used, and not when its
class is defined. A service imports 400 such classes, including FastAPI's classes for OpenAPI, and most runs
need only a few of them. This saves a third of the import time. In return, the first request to an endpoint
takes some milliseconds longer.
"""

import warnings

from pydantic import BaseModel
from pydantic.warnings import UnsupportedFieldAttributeWarning

BaseModel.model_config["defer_build"] = True
# FastAPI silences this warning too, but only while a route is made.
warnings.simplefilter("ignore", UnsupportedFieldAttributeWarning)
