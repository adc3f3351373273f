"""List a workspace's jobs (uploads, runs' G-code), store uploads, take a set-up from a recipe."""

from __future__ import annotations

import codecs
import json
import logging
import os
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import IO, Annotated, Any, Final

from fastapi import Path as PathParam

from design.files import write_text
from printctl.web.errors import BadRequestError, ConflictError, NotFoundError
from printctl.web.security.uploads import save_upload
from printctl.web.workspace import Workspace, file_hash, usable_name

log = logging.getLogger("printctl.web")

JobId = Annotated[str, PathParam(max_length=80, description="run~NAME or file~NAME.")]
ENDINGS: Final = (".gcode", ".gco", ".g", ".nc")
_HEAD_BYTES: Final = 512


@dataclass(frozen=True)
class JobEntry:
    """One job; figures of its dry run are None before the first.

    ``id`` is ``run~NAME`` or ``file~NAME``, ``size`` in bytes, ``changed`` s since 1970;
    ``layers`` are an embedded print's passes.
    """

    id: str
    name: str
    sha256: str
    size: int
    changed: float
    duration_s: float | None = None
    ink_ul: float | None = None
    layers: int | None = None
    vessels: int | None = None
    commands: int | None = None


def all_jobs(workspace: Workspace) -> list[JobEntry]:
    """Every job, the newest first, but for files that can't be read."""
    entries = []
    for job in workspace.jobs():
        try:
            entries.append(entry_of(workspace, job))
        except (
            OSError,
            NotFoundError,
            BadRequestError,
        ):  # gone, or a link that leads out
            log.warning("job %s can't be read", job, exc_info=True)
    return entries


def keep_facts(workspace: Workspace, facts: dict[str, Any]) -> None:
    """Remember what the dry run of a job has found, its ``sha256`` among it."""
    write_text(_facts_file(workspace, facts["sha256"]), json.dumps(facts) + "\n")


def _facts_file(workspace: Workspace, sha256: str) -> Path:
    return workspace.private / "jobs" / f"{sha256}.json"


def entry_of(workspace: Workspace, job: str) -> JobEntry:
    """One job, with what is known of it without a dry run."""
    path = workspace.job_file(job)
    stat, sha256 = path.stat(), file_hash(path)
    known = _facts(_facts_file(workspace, sha256)) or _facts(path.with_name("dry_run.json"))
    return JobEntry(
        id=job,
        name=job.partition("~")[2],
        sha256=sha256,
        size=stat.st_size,
        changed=stat.st_mtime,
        ink_ul=known.get("ink_ul", known.get("ink_pushed_ul")),
        **{name: known.get(name) for name in ("duration_s", "layers", "vessels", "commands")},
    )


def add_job(workspace: Workspace, name: str, stream: IO[bytes], limit_bytes: int) -> str:
    """Keep an uploaded G-code file, and return the job; nothing in it is run.

    ``name`` is as the user's file is called; see `usable_name`. The same file again does no harm.
    BadRequestError for a name that can't be, a file that is too large, or no text; ConflictError
    when another file of that name is there.
    """
    target = workspace.inside(workspace.root / "jobs" / job_name(name))
    with TemporaryDirectory(dir=workspace.private) as folder:
        came = Path(folder) / target.name
        save_upload(stream, came, limit_bytes)
        refuse_binary(came)
        if target.exists() and file_hash(target) == file_hash(came):
            return f"file~{target.name}"
        save_name(came, target)
    return f"file~{target.name}"


def save_name(came: Path, target: Path) -> None:
    """Give a file its place unless there is one; of two that come at once one gets it."""
    target.parent.mkdir(parents=True, exist_ok=True)
    try:
        os.link(came, target)
    except FileExistsError as exc:
        raise ConflictError(
            f"there is another file {target.name} already; give this one another name, so that "
            "its prints' journals aren't mixed up"
        ) from exc


def refuse_binary(path: Path) -> None:
    """Refuse a file with a zero byte, or whose first bytes aren't printable UTF-8."""
    refused = BadRequestError(f"{path.name} isn't text, so it is no G-code file")
    with path.open("rb") as handle:
        try:  # the head's end may cut a character
            head = codecs.getincrementaldecoder("utf-8")().decode(handle.read(_HEAD_BYTES))
        except UnicodeDecodeError as exc:
            raise refused from exc
        if not all(char.isprintable() or char in "\t\r\n\f\ufeff" for char in head):
            raise refused
        while part := handle.read(1 << 20):
            if b"\0" in part:
                raise refused


def job_name(name: str) -> str:
    """The name that an uploaded file is kept under: ``.gcode`` at its end."""
    ending = next((one for one in ENDINGS if name.lower().endswith(one)), None)
    if ending is None:
        raise BadRequestError(
            f"{name[:80]!r} doesn't end in {', '.join(ENDINGS)}; upload a G-code file"
        )
    return usable_name(f"{name[: -len(ending)]}.gcode")


def _facts(path: Path) -> dict[str, Any]:
    try:
        facts = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return facts if isinstance(facts, dict) else {}
