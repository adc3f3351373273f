"""HTML views of a run's network and layers and of a recipe's tissue, cached until files change."""

from __future__ import annotations

import hashlib
import json
import threading
from pathlib import Path
from typing import Any, Final

from printctl.run_folder.artefacts import GCODE, LINE_MAP, NETWORK, OXYGEN, SOLID
from printctl.web.errors import ConflictError
from printctl.web.worker import run_worker

LUMENS: Final = "lumens.json"
_OF_NETWORK: Final = (NETWORK, "flow.csv", "tissue.stl", LUMENS, OXYGEN, "registration.json")
_OF_GCODE: Final = (GCODE, LINE_MAP, SOLID)
_MAKING: Final = threading.Lock()
"""One page is made at a time: two would take the memory of both."""
_LONGEST_S: Final = 600.0


def network_page(run: Path, kept: Path) -> Path:
    """The page of a run's network in its tissue.

    Parameters
    ----------
    run : Path
        Run folder.
    kept : Path
        Folder for pages.

    Raises
    ------
    ConflictError
        When the run has no network yet.
    """
    if not (run / NETWORK).is_file():
        raise ConflictError(f"run {run.name!r} has no network yet; make the design first")

    return _kept(run, kept, "network", _OF_NETWORK)


def gcode_page(run: Path, kept: Path) -> Path:
    """The page of a run's layers or passes, with a slider.

    Raises
    ------
    ConflictError
        When the run has no G-code yet.
    """
    if not (run / GCODE).is_file():
        raise ConflictError(f"run {run.name!r} has no G-code yet; make the design first")

    return _kept(run, kept, "gcode", _OF_GCODE)


def tissue_page(recipe: Path, section: Any, kept: Path) -> Path:
    """The page of a recipe's tissue, on which places are picked.

    Parameters
    ----------
    recipe : Path
    section : JSON value
        What it says of the tissue.
    kept : Path
        Folder for pages.

    Raises
    ------
    ConflictError
        When the tissue can't be made.
    """
    words = json.dumps(section)
    named = [path for path in sorted(recipe.parent.iterdir()) if json.dumps(path.name) in words]
    return _page(recipe, kept, "tissue", [words, *_state(named)])


def _kept(run: Path, kept: Path, sort: str, names: tuple[str, ...]) -> Path:
    """The page made of these files as they are; made now when they have changed."""
    files = [run / name for name in names if (run / name).is_file()]
    return _page(run, kept, sort, _state(files))


def _state(files: list[Path]) -> list[Any]:
    return [(path.name, path.stat().st_mtime_ns, path.stat().st_size) for path in files]


def _page(run: Path, kept: Path, sort: str, state: list[Any]) -> Path:
    digest = hashlib.sha256(json.dumps(state).encode()).hexdigest()[:16]
    page = kept / f"{run.stem}.{sort}.{digest}.html"
    with _MAKING:
        if not page.is_file():
            kept.mkdir(parents=True, exist_ok=True)
            _make(sort, run, page)
            for old in kept.glob(f"{run.stem}.{sort}.*.html"):
                if old != page:
                    old.unlink(missing_ok=True)
    return page


def _make(sort: str, run: Path, page: Path) -> None:
    run_worker(
        "printctl.web.design.run_views.make",
        sort,
        str(run),
        str(page),
        longest_s=_LONGEST_S,
        late=f"the page of {run.stem!r} wasn't made within {_LONGEST_S:g} s; look at it by "
        "`printctl view`",
        died=f"the page of {run.stem!r} couldn't be made",
    )
