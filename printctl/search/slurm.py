"""Run a search's Dask workers as an array job of the Slurm cluster this machine belongs to."""

from __future__ import annotations

import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from design.files import write_text
from printctl.analysis.flow.ranks.slurm import SlurmJob, batch_head, slurm_job
from printctl.errors import PrintctlError, UsageError
from printctl.search.guarded import guarded_cluster

_ASKING_S: Final = 60.0
"""Of sbatch and scancel."""
_DEATH_S: Final = 120
"""After which a worker ends that doesn't find the search any more."""
_KEYS: Final = ("tls_ca_file", "tls_worker_cert", "tls_worker_key")


@dataclass(frozen=True)
class SlurmWorkers:
    """Jobs that grow candidates.

    Attributes
    ----------
    count : int
    job : SlurmJob
        Each, with a worker a task.
    folder : Path
        For the jobs' script, logs and, while they run, key; all machines see it.
    """

    count: int
    job: SlurmJob
    folder: Path


def slurm_workers(count: int | None, settings: Sequence[str], out: Path) -> SlurmWorkers | None:
    """Return what ``--slurm`` and ``--slurm-set`` ask for.

    Raises
    ------
    UsageError
        For settings without jobs, and as `slurm_job`.
    """
    if count is None:
        if settings:
            raise UsageError(f"--slurm-set {settings[0]} needs --slurm JOBS")
        return None
    defaults = [f"python={sys.executable}", "ntasks=1", "mem=4G"]
    return SlurmWorkers(count, slurm_job([*defaults, *settings]), out.resolve() / "slurm")


def slurm_cluster(stack: ExitStack, workers: SlurmWorkers) -> Any:
    """Begin a scheduler here and submit the jobs; ``stack`` ends both.

    Raises
    ------
    PrintctlError
        When Slurm isn't here, or refuses.
    """
    from distributed.security import Security
    from distributed.utils import get_ip

    if shutil.which("sbatch") is None:
        raise PrintctlError(
            "no sbatch here; begin the search on a login node, or leave --slurm out"
        )
    security = Security.temporary()
    cluster = guarded_cluster(stack, 0, get_ip(), security)
    workers.folder.mkdir(parents=True, exist_ok=True)
    keys = Path(
        stack.enter_context(tempfile.TemporaryDirectory(prefix=".key-", dir=workers.folder))
    )
    for name in _KEYS:  # the folder is this user's alone
        write_text(keys / name, getattr(security, name))
    script = workers.folder / "workers.sh"
    write_text(script, _script(workers, cluster.scheduler_address, keys))
    number = _asked(
        ["sbatch", "--parsable", f"--array=1-{workers.count}", script.name], workers.folder
    )
    stack.callback(_cancel, number.partition(";")[0])
    return cluster


def _script(workers: SlurmWorkers, address: str, keys: Path) -> str:
    command = [workers.job.python, "-m", "distributed.cli.dask_worker", address, "--nworkers", "1"]
    command += ["--nthreads", "1", "--no-dashboard", "--death-timeout", str(_DEATH_S)]
    for option, name in zip(("ca-file", "cert", "key"), _KEYS, strict=True):
        command += [f"--tls-{option}", str(keys / name)]
    body = [
        *workers.job.setup,
        "export OMP_NUM_THREADS=1",
        f'srun {shlex.join(command)} --local-directory "${{TMPDIR:-/tmp}}"',
    ]
    return "\n".join([*batch_head(workers.job, "printctl-search", "%A_%a.log"), *body]) + "\n"


def _asked(command: list[str], folder: Path | None = None) -> str:
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=_ASKING_S, cwd=folder, check=False
        )
    except (OSError, subprocess.TimeoutExpired) as exc:
        raise PrintctlError(f"{command[0]} doesn't answer: {exc}") from exc
    if done.returncode:
        reply = " ".join((done.stderr or done.stdout).split())
        raise PrintctlError(f"{command[0]} refuses: {reply[:500]}; see --slurm-set")
    return done.stdout.strip()


def _cancel(number: str) -> None:
    with suppress(PrintctlError):  # jobs end by themselves once the search is gone
        _asked(["scancel", number])
