"""The web service.

Pydantic builds the validator and serializer of a model when the model is first used, not when its class is
defined. The service imports 400 such classes, including FastAPI's OpenAPI classes, but most runs use only a
few of them, so this saves a third of the import time. In return, the first request to an endpoint takes a few
milliseconds longer.
"""

import warnings

from pydantic import BaseModel
from pydantic.warnings import UnsupportedFieldAttributeWarning

BaseModel.model_config["defer_build"] = True
# FastAPI also silences this warning, but only while it creates a route.
warnings.simplefilter("ignore", UnsupportedFieldAttributeWarning)
