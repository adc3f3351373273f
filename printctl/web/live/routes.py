"""REST routes of the live view: a job's scene, and its scripts."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from fastapi import APIRouter, HTTPException, Request, Response

from printctl.web.live.errors import SceneError
from printctl.web.live.maker_client import SceneMaker
from printctl.web.live.modules import static_files
from printctl.web.live.source import JobSource

Jobs = Callable[[str], JobSource]
"""Finds a job by its name in the URL; raises `KeyError` for one that isn't there."""

# Asked for again each time, answered by 304 unless it changed: an update of the program must not
# meet the scripts of the one before.
_KEPT = {"Cache-Control": "private, no-cache"}


def router(jobs: Jobs, maker: SceneMaker) -> APIRouter:
    """Routes ``/live/static/{name}`` and ``/live/{job}/scene``.

    Parameters
    ----------
    jobs : callable
        Must refuse every name but those of its own jobs.
    maker : SceneMaker
        Started and closed by the application.
    """
    routes = APIRouter(prefix="/live", tags=["live view"])

    @routes.get("/static/{name}", include_in_schema=False)
    async def static(name: str, request: Request) -> Response:
        file = static_files().get(name)
        if file is None:
            raise HTTPException(404, "no such file of the live view")
        return _answer(request, file.tag, file.data, file.media_type)

    @routes.get(
        "/{job}/scene",
        response_class=Response,
        responses={
            200: {"content": {"application/octet-stream": {}}},
            304: {"description": "The same as the ETag that was sent."},
            404: {"description": "There is no such job."},
            422: {"description": "The job can't be shown; `detail` says why."},
        },
    )
    async def scene(job: str, request: Request) -> Response:
        """A job's moves, packed as `printctl.web.live.pack` says."""
        try:
            source = await asyncio.to_thread(jobs, job)
        except KeyError as exc:
            raise HTTPException(404, "there is no such job") from exc
        try:
            path = await maker.scene_file(source)
            tag = f'"{path.stem}"'
            data = b"" if _has(request, tag) else await asyncio.to_thread(path.read_bytes)
        except SceneError as exc:
            raise HTTPException(422, str(exc)) from exc
        except OSError as exc:
            raise HTTPException(422, f"the view of this job can't be read: {exc.strerror}") from exc
        return _answer(request, tag, data, "application/octet-stream")

    return routes


def _has(request: Request, tag: str) -> bool:
    """Whether the browser holds what has this tag."""
    held = request.headers.get("if-none-match", "")
    return tag in [each.strip().removeprefix("W/") for each in held.split(",")]


def _answer(request: Request, tag: str, data: bytes, media_type: str) -> Response:
    headers = {**_KEPT, "ETag": tag, "X-Content-Type-Options": "nosniff"}
    if _has(request, tag):
        return Response(status_code=304, headers=headers)
    return Response(data, media_type=media_type, headers=headers)
