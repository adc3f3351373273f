"""Pydantic base of recipe sections and profiles: unknown keys refused, frozen, strict numbers."""

from __future__ import annotations

from typing import Any, Final

from pydantic import BaseModel, ConfigDict, GetCoreSchemaHandler
from pydantic_core import CoreSchema

_STRICT: Final = frozenset({"bool", "float", "int", "str"})


def _make_strict(schema: Any) -> None:
    """Let no text or truth value pass for a number in a schema and all that it holds."""
    if isinstance(schema, dict):
        if schema.get("type") in _STRICT:
            schema.setdefault("strict", True)
        for part in schema.values():
            _make_strict(part)
    elif isinstance(schema, list | tuple):
        for part in schema:
            _make_strict(part)


class StrictModel(BaseModel):
    """Base of recipe sections and profiles.

    Text and true aren't numbers, 1 isn't true; a whole number passes for any number. Lists still
    pass for tuples, which pydantic's own strict mode refuses.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """The model's schema, with every plain value strict."""
        schema = handler(source)
        _make_strict(schema)
        return schema
