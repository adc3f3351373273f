"""Add the access guard's error responses to the OpenAPI description of every route."""

from __future__ import annotations

from typing import Any, Final

from fastapi import FastAPI

from printctl.web.api.answers import REFUSALS

OF_THE_GUARD: Final = (401, 403, 413, 421, 429)
_PROBLEM: Final = {"application/json": {"schema": {"$ref": "#/components/schemas/Problem"}}}


def describe_refusals(app: FastAPI) -> None:
    """Have every route of the description say how it may be refused."""
    described = app.openapi

    def openapi() -> dict[str, Any]:
        whole = described()
        for item in whole["paths"].values():
            for operation in item.values():
                answers = operation["responses"]
                for status in OF_THE_GUARD:
                    refusal = {"description": REFUSALS[status]["description"], "content": _PROBLEM}
                    answers.setdefault(str(status), refusal)
        return whole

    app.openapi = openapi  # type: ignore[method-assign]
