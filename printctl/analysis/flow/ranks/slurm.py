"""Parse Slurm settings (NAME=VALUE); write the batch script of a 3D flow case."""

from __future__ import annotations

import re
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from design.files import write_text
from printctl.errors import UsageError

_TIME: Final = re.compile(r"(\d+-)?\d{1,2}(:\d{2}){1,2}|\d+")
_MEMORY: Final = re.compile(r"\d+[KMGT]?")
_NAME: Final = re.compile(r"[\w.-]+")
_SETTINGS: Final = "nodes, ntasks, time, mem, partition, account, python, setup"


@dataclass(frozen=True)
class SlurmJob:
    """What a batch job asks for.

    Attributes
    ----------
    nodes, ntasks : int
        Machines, and ranks over all of them.
    time : str
        Limit, as Slurm writes it: ``minutes``, ``hh:mm:ss`` or ``days-hh:mm:ss``.
    memory : str
        Of each node, such as ``64G``; ``0`` is all of it.
    python : str
        With dolfinx, there.
    setup : tuple of str
        Lines run before, such as ``module load openmpi``.
    partition, account : str, optional
    """

    nodes: int = 1
    ntasks: int = 16
    time: str = "02:00:00"
    memory: str = "0"
    python: str = "python3"
    setup: tuple[str, ...] = ()
    partition: str | None = None
    account: str | None = None

    def __post_init__(self) -> None:
        if self.nodes < 1 or self.ntasks < self.nodes:
            raise UsageError(
                f"{self.ntasks} tasks on {self.nodes} nodes; give at least one node and a task "
                "for each"
            )
        for name, value, shape in (
            ("time", self.time, _TIME),
            ("mem", self.memory, _MEMORY),
            ("partition", self.partition, _NAME),
            ("account", self.account, _NAME),
        ):
            if value is not None and not shape.fullmatch(value):
                raise UsageError(f"--{name} {value!r} isn't as Slurm writes it, such as "
                                 "02:00:00 or 1-12:00:00, 64G, a name")  # fmt: skip


def slurm_job(settings: Sequence[str]) -> SlurmJob:
    """A job from ``NAME=VALUE`` settings, as they are typed; ``setup`` may be given again.

    Raises
    ------
    UsageError
        For a name that `SlurmJob` doesn't have, and as `SlurmJob`.
    """
    given: dict[str, Any] = {}
    for setting in settings:
        name, equals, value = setting.partition("=")
        field = {"mem": "memory"}.get(name, name)
        if not equals or field not in SlurmJob.__dataclass_fields__:
            raise UsageError(f"--slurm-set {setting}: give NAME=VALUE, a name of {_SETTINGS}")
        if field == "setup":
            given["setup"] = (*given.get("setup", ()), value)
        elif field in ("nodes", "ntasks"):
            given[field] = _count(name, value)
        else:
            given[field] = value
    return SlurmJob(**given)


def _count(name: str, value: str) -> int:
    if not (value.isascii() and value.isdigit()):
        raise UsageError(f"--slurm-set {name}={value}: give a whole number from 1")
    return int(value)


def write_slurm(path: Path, case_folder: Path, job: SlurmJob) -> None:
    """Write the script; ``sbatch`` it from anywhere, `case_folder` is named in full.

    Raises
    ------
    UsageError
        When the folder holds no case.
    OSError
        When the file can't be written.
    """
    if not (case_folder / "case.json").is_file():
        raise UsageError(f"{case_folder} holds no case.json; write the case first")
    body = [
        "set -euo pipefail",
        "# Change to where the case is on the cluster, if it was copied there.",
        f"cd {shlex.quote(str(case_folder.resolve()))}",
        *job.setup,
        "export OMP_NUM_THREADS=1",
        "unset PYTHONPATH",
        "# mpirun instead, where this MPI wasn't built for Slurm.",
        f"srun {shlex.quote(job.python)} -m engine .",
    ]
    head = batch_head(job, "printctl-flow", "printctl-flow-%j.log")
    write_text(path, "\n".join([*head, *body]) + "\n")


def batch_head(job: SlurmJob, name: str, log: str) -> list[str]:
    """Return a batch script's first lines."""
    asked = {
        "job-name": name,
        "nodes": job.nodes,
        "ntasks": job.ntasks,
        "cpus-per-task": 1,
        "time": job.time,
        "mem": job.memory,
        "partition": job.partition,
        "account": job.account,
        "output": log,
    }
    lines = [f"#SBATCH --{key}={value}" for key, value in asked.items() if value is not None]
    return ["#!/bin/bash", *lines]
