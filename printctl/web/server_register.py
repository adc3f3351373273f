"""Register of a running web server in its workspace: lock, and address for other programs."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from typing import Any, Final

from filelock import FileLock, Timeout

from printctl.errors import PrintctlError
from printctl.web.workspace import Workspace

SERVE: Final = "serve.json"


class AlreadyServedError(PrintctlError):
    """Another server runs in the workspace."""


@dataclass(frozen=True)
class Running:
    """A server, as ``.printctl/serve.json`` tells of it; only the owner may read the file.

    Attributes
    ----------
    url : str
    pid : int
    token : str
        For scripts: ``Authorization: Bearer TOKEN``.
    stop : str
        Address of the stop process; empty when there is none.
    started : float, s
        Unix time.
    """

    url: str
    pid: int
    token: str = field(repr=False)
    stop: str
    started: float

    def save(self, workspace: Workspace) -> None:
        """Write it for whoever looks for the server."""
        path = workspace.private / SERVE
        new = path.with_suffix(".new")
        new.unlink(missing_ok=True)
        handle = os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            json.dump(asdict(self), file, indent=1)
        new.replace(path)


def find_server(workspace: Workspace) -> Running | None:
    """The server of a workspace; None when it has none, or its end wasn't orderly."""
    try:
        values: dict[str, Any] = json.loads((workspace.private / SERVE).read_text(encoding="utf-8"))
        return Running(**values)
    except (FileNotFoundError, ValueError, TypeError):
        return None


@contextmanager
def only_server(workspace: Workspace) -> Iterator[None]:
    """Hold the workspace's lock.

    Raises
    ------
    AlreadyServedError
        When another server holds it.
    """
    lock = FileLock(workspace.private / "serve.lock")
    try:
        lock.acquire(timeout=0)
    except Timeout as exc:
        other = find_server(workspace)
        where = f" at {other.url} (process {other.pid})" if other else ""
        raise AlreadyServedError(
            f"the workspace {workspace.root} is served already{where}; open that page, or end "
            "that server first"
        ) from exc
    try:
        yield
    finally:
        (workspace.private / SERVE).unlink(missing_ok=True)
        lock.release()
