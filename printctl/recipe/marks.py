"""Pydantic string types of recipe keys that name a profile; metadata mark of file keys."""

from __future__ import annotations

from typing import Annotated, Any, Final

from pydantic import Field

FILE: Final[dict[str, Any]] = {"file": True}
"""For ``json_schema_extra`` of a path that is relative to the recipe."""

PrinterName = Annotated[
    str,
    Field(
        description="Shipped name or path of a .yaml.", json_schema_extra={"profile": "printers"}
    ),
]
PlateName = Annotated[
    str,
    Field(description="Shipped name or path of a .yaml.", json_schema_extra={"profile": "plates"}),
]
NeedleName = Annotated[str, Field(json_schema_extra={"profile": "needles"})]
SyringeName = Annotated[str, Field(json_schema_extra={"profile": "syringes"})]
InkName = Annotated[str, Field(json_schema_extra={"profile": "inks"})]
BathName = Annotated[str, Field(json_schema_extra={"profile": "baths"})]
DishName = Annotated[str, Field(json_schema_extra={"profile": "dishes"})]
