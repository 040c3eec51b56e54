"""Access tokens, as JSON."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, Field

from cobot.access.roles import RoleName
from cobot.access.tokens import MAX_DAYS, MAX_TOKENS, NAME
from cobot.loose_lists import RequestModel
from cobot.motions.fields import example

Time = Annotated[str, Field(description="ISO 8601 in UTC.")]


class CreateToken(RequestModel):
    """A token to create."""

    model_config = example({"name": "anna", "role": "operator"})

    name: str = Field(
        pattern=NAME,
        description="Name of a person or program, for the log and the audit log: letters, digits and . _ @ -",
    )
    role: RoleName = Field(
        description="Role of its holder. Each role includes the rights of the previous one."
    )
    days: float | None = Field(
        None, gt=0, le=MAX_DAYS, description="Lifetime in days; without it, the token never expires."
    )


class TokenEntry(BaseModel):
    """An access token in the list. The token itself is not stored."""

    name: str = Field(description="Name of its holder.")
    role: RoleName = Field(description="Role of its holder.")
    created: Time
    expires: Time | None = Field(description="Time of expiry; null: the token never expires.")


class KnownToken(TokenEntry):
    """An access token in the list, with its use."""

    last_used: Time | None = Field(
        description="Time at which the service last accepted it; null: not since the service started."
    )
    own: bool = Field(description="Whether this request uses the token.")


class TokensAnswer(BaseModel):
    """All access tokens."""

    tokens: list[KnownToken] = Field(
        description=f"The tokens in the order of their creation, at most {MAX_TOKENS}."
    )
    required: bool = Field(description="Whether clients need a token to use this service.")
    hint: str = Field(description='What to do before tokens can be created here; "" if they can be created.')


class CreatedToken(TokenEntry):
    """A newly created token."""

    token: str = Field(description="The token. It is not stored; only this answer has it.")
