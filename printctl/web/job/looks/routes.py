"""REST routes for a print's inspections (looks): records, pictures, the operator's answer."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Path, Query, Request, Response
from pydantic import BaseModel, ConfigDict, Field

from printctl.web.controls import Principal
from printctl.web.job.looks.look_service import LookService, LookTold

Job = Annotated[str, Path(max_length=80, description="run~NAME or file~NAME.")]
Number = Annotated[int, Path(ge=1, le=10**6, description="Of the look, from 1.")]
Width = Annotated[int, Query(ge=64, le=4096, description="At most so wide, px.")]


class LookResponse(BaseModel):
    """One look at an observed print."""

    number: int = Field(description="From 1.")
    mark: str = Field(description="What had ended there.")
    done: int = Field(description="Command lines of the growing job that were taken.")
    job_line: int = Field(description="The same, without inserts.")
    at: float = Field(description="s since 1970.")
    decision: Literal["go_on", "flow", "mend", "pause", "stop"]
    why: str
    asked: Literal["", "mend", "flow", "pause"] = Field(
        description="What the operator is asked to approve; empty for nothing."
    )
    factor: float | None = Field(description="Flow factor that was put in force, or is proposed.")
    found: dict[str, Any] = Field(
        description="Figures: seen_share, coverage, width_ratio, gaps, shift_mm, blobs, ink."
    )
    seconds: dict[str, float]
    answer: Literal["approve", "go_on", "stop"] | None = Field(
        description="The operator's word; null while there is none."
    )
    waits: bool = Field(description="Whether the print is held for the operator's word on it.")
    pictured: float = Field(description="Of its picture, s since 1970; 0 for none.")
    seen: str = Field(description="How much was seen, as people read.")
    proposed: str = Field(description="What is proposed, as people read; empty for nothing.")
    outcome: str = Field(description="What came of it, as people read.")


class AnswerRequest(BaseModel):
    """The operator's word on a look, as ``printctl observe answer`` takes it."""

    model_config = ConfigDict(extra="forbid")

    answer: Literal["approve", "go_on", "stop"]


def add_routes(
    routes: APIRouter, service: LookService, who: Callable[[Request], Principal]
) -> None:
    """Add them to the job's room; ``who`` gives the requesting user."""

    @routes.get("/prints/{job}/looks", tags=["looks"], summary="Looks at the last print")
    def looks(job: Job) -> list[LookResponse]:
        return [_response(one) for one in service.looks(job)]

    @routes.get(
        "/prints/{job}/looks/{number}/picture",
        tags=["looks"],
        summary="A look's picture, with what was expected and found",
        response_class=Response,
        responses={200: {"content": {"image/jpeg": {}}}},
    )
    def picture(job: Job, number: Number, width: Width = 1600) -> Response:
        jpeg = service.picture(job, number, width)
        return Response(jpeg, media_type="image/jpeg", headers={"Cache-Control": "no-cache"})

    @routes.post(
        "/prints/{job}/looks/{number}/answer",
        tags=["looks"],
        summary="Answer a look that asks; 409 where the print doesn't wait for it",
    )
    def answer(job: Job, number: Number, given: AnswerRequest, request: Request) -> LookResponse:
        asking: Principal = who(request)
        return _response(service.answer(asking, job, number, given.answer))


def _response(look: LookTold) -> LookResponse:
    return LookResponse.model_validate(look.to_dict())
