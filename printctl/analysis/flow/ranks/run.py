"""Run the MPI ranks of a 3D flow case on this machine, with progress and clean-up."""

from __future__ import annotations

import os
import signal
import subprocess
import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from design.hemodynamics.three_d.ranks import RankResult, read_result
from printctl.analysis.flow.ranks.engine import (
    clean_environment,
    find_engine,
    find_mpirun,
    rank_command,
)
from printctl.errors import PrintctlError, UsageError

GRACE_S: Final = 10.0


def run_on_ranks(
    case_folder: Path,
    ranks: int,
    python: Path | None = None,
    tell: Callable[[str], None] | None = None,
) -> RankResult:
    """Solve a case that `write_case` wrote, on ``ranks`` processes of this machine.

    Parameters
    ----------
    case_folder : Path
    ranks : int
        From 1 to the machine's processors.
    python : Path, optional
        With dolfinx; else the first that `find_engine` finds.
    tell : callable, optional
        Is given each line of the log.

    Raises
    ------
    UsageError
        For fewer than one rank, more than processors, or a folder that holds no case.
    PrintctlError
        Without an engine, or when it fails; with the last lines it said.
    """
    _check(case_folder, ranks)
    engine = find_engine(python)
    command = [
        *rank_command(find_mpirun(engine.python), ranks),
        *(str(engine.python), "-m", "engine", "."),
    ]
    code, last = _followed(command, case_folder, tell or (lambda line: None))
    if code != 0:
        output = "\n".join(last) or "nothing was said"
        raise PrintctlError(f"the {ranks} ranks ended with code {code}:\n{output}")
    return read_result(case_folder)


def _check(case_folder: Path, ranks: int) -> None:
    if not (case_folder / "case.json").is_file():
        raise UsageError(f"{case_folder} holds no case.json; write the case first")
    most = os.cpu_count() or 1
    if not 1 <= ranks <= most:
        raise UsageError(
            f"{ranks} ranks on {most} processors; give 1 to {most}, or write a batch script for "
            "a cluster"
        )


def _followed(
    command: list[str], folder: Path, tell: Callable[[str], None]
) -> tuple[int, deque[str]]:
    """Run to the end, telling each line; whatever ends us ends it."""
    last: deque[str] = deque(maxlen=20)
    process = subprocess.Popen(
        command, cwd=folder, env=clean_environment(), text=True, errors="replace",
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        start_new_session=True,
    )  # fmt: skip
    try:
        assert process.stdout is not None
        with _ending_too(), process.stdout as lines:
            for line in lines:
                last.append(line.rstrip())
                tell(line.rstrip())
        return process.wait(), last
    finally:
        _end(process)


@contextmanager
def _ending_too() -> Iterator[None]:
    """Have a request to end come as an exception, as Ctrl-C does, so that the ranks end first."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    signals = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
    before = {each: signal.signal(each, _leave) for each in signals}
    try:
        yield
    finally:
        for each, handler in before.items():
            signal.signal(each, handler)


def _leave(number: int, frame: object) -> None:
    raise SystemExit(128 + number)


def _end(process: subprocess.Popen[str]) -> None:
    """End mpirun, which ends its ranks when asked politely; its group when it doesn't."""
    if process.poll() is not None:
        return
    process.terminate()
    try:
        process.wait(GRACE_S)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
