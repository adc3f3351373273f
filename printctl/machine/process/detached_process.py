"""Start a process that outlives its parent, or put the running one into the background."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Final

import printctl
from printctl.machine.errors import LinkError
from printctl.sources import python_command

START_LIMIT_S: Final = 60.0


def spawn(command: list[str]) -> int:
    """Start a process that detaches itself, and that no one waits for; give its number.

    Raises
    ------
    LinkError
        When it doesn't start.
    """
    root = str(Path(printctl.__file__).resolve().parents[1])
    paths = [root, *filter(None, [os.environ.get("PYTHONPATH")])]
    try:
        started = subprocess.run(
            command,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
            timeout=START_LIMIT_S,
            check=False,
        )
    except subprocess.TimeoutExpired as exc:
        raise LinkError(
            f"the process didn't start within {START_LIMIT_S:g} s: this machine has too much else "
            "to do; end that, then try again"
        ) from exc
    if started.returncode != 0:
        said = started.stderr.decode(errors="replace").strip()[-500:]
        raise LinkError(f"the process didn't start: {said}")
    return int(started.stdout)


def detach(log: Path, module: str) -> None:
    """Go on as a process of its own session, which nobody waits for; print its number.

    On Windows there is no fork; a copy of this command is started instead.
    """
    if not hasattr(os, "fork"):
        command = [*python_command(module), *sys.argv[1:]]
        command.remove("--detach")
        with log.open("ab") as handle:
            flags = 0x00000008 | 0x00000200  # DETACHED_PROCESS, CREATE_NEW_PROCESS_GROUP
            copy = subprocess.Popen(command, stdout=handle, stderr=handle, creationflags=flags)
        print(copy.pid, flush=True)
        os._exit(0)
    pid = os.fork()
    if pid:
        print(pid, flush=True)
        os._exit(0)
    os.setsid()
    null, out = os.open(os.devnull, os.O_RDWR), os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    for source, target in ((null, 0), (out, 1), (out, 2)):
        os.dup2(source, target)
