"""Live view: scripts, client of the scene's process, REST."""

from __future__ import annotations

import asyncio
import hashlib
import re
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Final
from urllib.parse import quote

from fastapi import APIRouter, HTTPException, Request, Response

from printctl.web.live.source import SOURCES, JobSource, SceneError, cached_scene
from printctl.web.worker import LineProcess

_STATIC: Final = Path(__file__).parent / "static"
_TYPES: Final = {".js": "text/javascript; charset=utf-8", ".css": "text/css; charset=utf-8"}
_BARE: Final = re.compile(rb'"(?:viewer|live)/(\w+)"')
_VIEWER: Final = ("flat.js", "lines.js", "page.js", "scale.js", "stage.js")
"""Modules of the reports' viewer that the live view needs."""
_NOT_AT_ONCE: Final = ("flat_painter.js",)
"""What only browsers without WebGL draw with."""


@cache
def static_files() -> dict[str, tuple[bytes, str, str]]:
    """Return data, tag (which changes with the data) and media type of each file, by name."""
    report = Path(__file__).parents[3] / "report"
    paths = {path.name: path for path in sorted(_STATIC.iterdir()) if path.suffix in _TYPES}
    paths |= {name: report / "viewer" / name for name in _VIEWER}
    paths["three.js"] = report / "vendor" / "three.module.min.js"
    paths["orbit.js"] = report / "vendor" / "OrbitControls.js"
    return {name: _read(name, path) for name, path in paths.items()}


def _read(name: str, path: Path) -> tuple[bytes, str, str]:
    data = path.read_bytes()
    if path.suffix == ".js" and name != "three.js":
        data = _BARE.sub(rb'"./\1.js"', data)
        for bare, url in ((b"three", b"./three.js"), (b"three/orbit", b"./orbit.js")):
            data = re.sub(rb"""from ['"]%b['"]""" % bare, b'from "%b"' % url, data)
    tag = f'"{hashlib.sha256(data).hexdigest()[:16]}"'
    return data, tag, _TYPES[path.suffix]


def preload(job: str) -> str:
    """HTML for the head of a page with a job's view.

    With it the browser fetches the moves and the scripts while it reads those of the page, about a
    second earlier.
    """
    scripts = (one for one in static_files() if one.endswith(".js") and one not in _NOT_AT_ONCE)
    return (
        f'<link rel="preload" as="fetch" crossorigin href="/live/{quote(job, safe="~")}/scene">'
        '<link rel="stylesheet" href="/live/static/live_view.css">'
    ) + "".join(f'<link rel="modulepreload" href="/live/static/{name}">' for name in scripts)


_LONGEST_S: Final = 120.0
"""For a job of 50 million moves."""
# Arrays of a large job come and go by the dozen: glibc otherwise hands each back to the system and
# asks for it again, a tenth of the time that a scene takes. The process holds 0.7 GB after a
# million moves instead; other systems ignore these.
_KEEP_MEMORY: Final = {
    "MALLOC_MMAP_THRESHOLD_": "4000000000",
    "MALLOC_TRIM_THRESHOLD_": "4000000000",
}


class SceneMaker(LineProcess):
    """Makes scenes, one at a time, without the event loop waiting for any of it.

    The process begins with `start`, best when the server does (importing and loading the kernels
    takes seconds), or with the first job; it begins again when it died. ``longest_s`` is the time
    that a scene may take.
    """

    def __init__(self, longest_s: float = _LONGEST_S) -> None:
        super().__init__("printctl.web.live.scene_worker", _KEEP_MEMORY)
        self._longest_s = longest_s

    async def scene_file(self, source: JobSource) -> Path:
        """The file of a job's scene, made now unless it is there.

        Raises
        ------
        SceneError
            When the job can't be shown; the message is for the user.
        """
        path = await asyncio.to_thread(cached_scene, source)
        if path.is_file():
            return path
        async with self.turn:
            late = f"the view of {source.gcode.name} wasn't made in {self._longest_s:g} s; "
            answer = await self.ask(
                SOURCES.dump_json(source).decode(),
                self._longest_s,
                SceneError,
                late + "the print isn't touched by it",
                "the process that makes views ended",
            )
        return Path(answer["scene"])


Jobs = Callable[[str], JobSource]
"""Finds a job by its name in the URL; raises `KeyError` for one that isn't there."""
# Asked for again each time, answered by 304 unless it changed: an update of the program must not
# meet the scripts of the one before.
_KEPT = {"Cache-Control": "private, no-cache"}


def router(jobs: Jobs, maker: SceneMaker) -> APIRouter:
    """Routes ``/live/static/{name}`` and ``/live/{job}/scene``.

    ``jobs`` must refuse every name but those of its own jobs; the application closes ``maker``.
    """
    routes = APIRouter(prefix="/live", tags=["live view"])

    @routes.get("/static/{name}", include_in_schema=False)
    async def static(name: str, request: Request) -> Response:
        file = static_files().get(name)
        if file is None:
            raise HTTPException(404, "no such file of the live view")
        return _answer(request, *file)

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
        """A job's moves, packed as `printctl.web.live.scene_worker` says."""
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
        return _answer(request, data, tag, "application/octet-stream")

    return routes


def _has(request: Request, tag: str) -> bool:
    """Whether the browser holds what has this tag."""
    held = request.headers.get("if-none-match", "")
    return tag in [each.strip().removeprefix("W/") for each in held.split(",")]


def _answer(request: Request, data: bytes, tag: str, media_type: str) -> Response:
    headers = {**_KEPT, "ETag": tag, "X-Content-Type-Options": "nosniff"}
    if _has(request, tag):
        return Response(status_code=304, headers=headers)
    return Response(data, media_type=media_type, headers=headers)
