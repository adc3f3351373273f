"""Sketch a recipe's vessels while its values are changed: a process that keeps tissues ready.

The process grows what the stage ``vasculature`` would, in memory; nothing is written.
"""

from __future__ import annotations

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

from printctl.web.errors import ConflictError
from printctl.web.worker import LineProcess, run_at_low_priority

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


class SketchProcess(LineProcess):
    """The process that sketches; one sketch at a time, begun with the first."""

    def __init__(self) -> None:
        super().__init__(__name__)
        self._waiting = 0
        self._limit_s = FIRST_S

    async def sketch(
        self, recipe: dict[str, Any], folder: Path, known: str, behind: bool, gone: Gone
    ) -> dict[str, Any]:
        """Grow the vessels of a recipe, as `Recipe.model_dump` gives it.

        Parameters
        ----------
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
        self._waiting += 1
        try:
            await self.turn.acquire()
        finally:
            self._waiting -= 1
        limit_s = self._limit_s
        try:
            if await gone():
                raise ConflictError("nobody waits for this sketch any more")
            self._limit_s = FIRST_S  # of a process anew, should this one not answer
            late = f"the sketch wasn't done in {limit_s:g} s; make the design to see its vessels"
            died = "the process that sketches ended"
            answer = await self.ask(json.dumps(request), limit_s, ConflictError, late, died)
            self._limit_s = LONGEST_S
            return answer
        finally:
            self.turn.release()


def main() -> None:
    """Answer each line of stdin by a line of stdout."""
    from printctl.failures import message_and_code

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
    import numpy as np
    from rich.console import Console

    from printctl.pipeline.context import RunContext
    from printctl.pipeline.stages.design.vasculature import make_network, summarise
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
    pieces = np.column_stack([start, end, r0, r1])[::step]
    return {
        "pieces": pieces.round(4).ravel().tolist(),
        "kinds": network.kind[vessel][::step].tolist(),
        "outline": None if tag == known else _outline(tissue),
        "tissue": tag,
        "figures": summarise(network),
        "took_ms": round(1000 * (time.perf_counter() - began)),
    }


def _outline(tissue: Any) -> dict[str, list[float]]:
    """Return the tissue's surface in few triangles: vertices, mm, and faces, both flat."""
    from report.simplify import simplify
    from report.surface import ReportSurface

    surface = simplify(ReportSurface("tissue", tissue.surface), OUTLINE_FACES).surface
    return {
        "vertices": surface.vertices.round(3).ravel().tolist(),
        "faces": surface.faces.ravel().tolist(),
    }


if __name__ == "__main__":
    main()
