"""Sketch a recipe's vessels while its values are changed: a process that keeps tissues ready.

The process grows what the stage ``vasculature`` would, in memory; nothing is written.
"""

from __future__ import annotations

import asyncio
import hashlib
import io
import json
import os
import sys
import tempfile
import threading
import time
from collections.abc import Awaitable, Callable
from functools import partial
from pathlib import Path
from typing import Any, Final

from printctl.sources import python_command
from printctl.web.errors import ConflictError

Gone = Callable[[], Awaitable[bool]]
LONGEST_S: Final = 20.0
"""That a sketch may take; a recipe that takes longer is made without one."""
FIRST_S: Final = 60.0
"""The first one of a process, which may compile kernels."""
MOST_WAITING: Final = 8
"""Requests that wait for their turn; further ones are refused at once."""
OUTLINE_FACES: Final = 1500
"""Triangles of the tissue's outline: enough for a picture of 600 pixels."""
_MOST_PIECES: Final = 60_000
"""Straight pieces drawn; more take a browser longer than a twentieth of a second."""


class SketchProcess:
    """The process that sketches; one sketch at a time, begun with the first."""

    def __init__(self) -> None:
        self._process: asyncio.subprocess.Process | None = None
        self._one = asyncio.Lock()
        self._waiting = 0
        self._limit_s = FIRST_S

    async def sketch(
        self, recipe: dict[str, Any], folder: Path, known: str, behind: bool, gone: Gone
    ) -> dict[str, Any]:
        """Grow a recipe's vessels.

        Parameters
        ----------
        recipe : dict
            As `Recipe.model_dump` gives it.
        folder : Path
            Where the files lie that it names.
        known : str
            Tag of the outline that is there already.
        behind : bool
            Whether a print goes on, behind which it steps back.
        gone : coroutine function
            Whether who asked has left meanwhile; then nothing is grown.

        Raises
        ------
        ConflictError
            When the vessels can't be grown, or too many wait; the message is for the user.
        """
        if self._waiting >= MOST_WAITING:
            raise ConflictError(f"{MOST_WAITING} others wait for a sketch; try again in a moment")
        request = {"recipe": recipe, "folder": str(folder), "known": known, "behind": behind}
        line = json.dumps(request) + "\n"
        self._waiting += 1
        try:
            await self._one.acquire()
        finally:
            self._waiting -= 1
        try:
            if await gone():
                raise ConflictError("nobody waits for this sketch any more")
            async with asyncio.timeout(self._limit_s):
                answer = await self._asked(line)
            self._limit_s = LONGEST_S
        except TimeoutError as exc:
            await self.close()
            raise ConflictError(
                f"the sketch wasn't done in {self._limit_s:g} s; make the design to see its vessels"
            ) from exc
        except ConflictError:
            raise
        except BaseException:
            await self.close()  # an answer still to come mustn't meet the next question
            raise
        finally:
            self._one.release()
        if "error" in answer:
            raise ConflictError(answer["error"])
        return answer

    async def close(self) -> None:
        """End the process."""
        process, self._process = self._process, None
        self._limit_s = FIRST_S
        if process is not None and process.returncode is None:
            process.kill()
            await process.wait()

    async def _asked(self, line: str) -> dict[str, Any]:
        if self._process is None or self._process.returncode is not None:
            self._process = await asyncio.create_subprocess_exec(
                *python_command(__name__),
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.PIPE,
                limit=2**26,
            )
        process = self._process
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            process.stdin.write(line.encode())
            await process.stdin.drain()
            said = await process.stdout.readline()
        except OSError as exc:
            raise ConflictError(f"the process that sketches ended: {exc.strerror}") from exc
        if not said:
            raise ConflictError("the process that sketches ended; see the server's messages")
        answer: dict[str, Any] = json.loads(said)
        return answer


def main() -> None:
    """Answer each line of stdin by a line of stdout."""
    from printctl.failures import message_and_code
    from printctl.web.worker import run_at_low_priority

    threading.Thread(target=_end_with, args=[os.getppid()], daemon=True).start()
    answers, sys.stdout = sys.stdout, sys.stderr  # whatever is printed isn't an answer
    tissues: dict[str, Any] = {}
    for line in sys.stdin:
        request = json.loads(line)
        behind = request.pop("behind")
        work = partial(_sketched, **request, tissues=tissues)
        try:
            answer = run_at_low_priority(work) if behind else work()
        except Exception as exc:
            known = message_and_code(exc)
            answer = {"error": known[0] if known else f"{type(exc).__name__}: {exc}"}
        answers.write(json.dumps(answer) + "\n")
        answers.flush()


def _end_with(parent: int) -> None:
    """End this process when its server is gone, whatever it grows."""
    while os.getppid() == parent:
        time.sleep(1.0)
    os._exit(0)


def _sketched(
    recipe: dict[str, Any], folder: str, known: str, tissues: dict[str, Any]
) -> dict[str, Any]:
    from rich.console import Console

    from printctl.pipeline.context import RunContext
    from printctl.pipeline.stages.vasculature import make_network, summarise
    from printctl.progress import StageBars
    from printctl.recipe import Recipe
    from printctl.run_folder.manifest import Manifest

    began = time.perf_counter()
    whole = Recipe.model_validate(recipe)
    with tempfile.TemporaryDirectory() as scratch:
        quiet = StageBars(Console(file=io.StringIO()))
        context = RunContext(whole, Path(folder), Path(scratch), Manifest(Path(scratch)), quiet)
        said = json.dumps([whole.tissue.model_dump(mode="json"), folder], sort_keys=True)
        digests = json.dumps(context.digests(whole.tissue.files()))
        tag = hashlib.sha256((said + digests).encode()).hexdigest()[:16]
        if tag in tissues:
            context.__dict__["tissue"] = tissues[tag]  # what the cached property would make anew
        tissue = tissues[tag] = context.tissue
        while len(tissues) > 4:  # organs of a million triangles are large
            tissues.pop(next(iter(tissues)))
        network, _ = make_network(context)
    start, end, r0, r1, vessel = network.pieces()
    step = max(1, -(-len(start) // _MOST_PIECES))
    rows = [(*a, *b, p, q) for a, b, p, q in zip(start, end, r0, r1, strict=True)]
    return {
        "pieces": [round(float(value), 4) for row in rows[::step] for value in row],
        "kinds": network.kind[vessel][::step].tolist(),
        "outline": None if tag == known else _outline(tissue),
        "tissue": tag,
        "figures": summarise(network),
        "took_ms": round(1000 * (time.perf_counter() - began)),
    }


def _outline(tissue: Any) -> dict[str, list[float]]:
    """Return the tissue's surface in few triangles: vertices, mm, and faces, both flat."""
    from registration.report.simplify import simplify
    from registration.report.surface import ReportSurface

    surface = simplify(ReportSurface("tissue", tissue.surface), OUTLINE_FACES).surface
    return {
        "vertices": [round(float(value), 3) for value in surface.vertices.ravel()],
        "faces": surface.faces.ravel().tolist(),
    }


if __name__ == "__main__":
    main()
