"""Simulated printers and peers of the link benchmark, as processes with profiles."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import yaml

from benchmarks.link_files import START_MM
from benchmarks.machine import ROOT


class PeerFailedError(Exception):
    """A process of the benchmark didn't do what it should, and what it said."""


def profile(folder: Path, name: str, **changes: object) -> str:
    """A variant of `generic_marlin`; its path."""
    data = ROOT / "firmware_profiles" / "data" / "printers" / "generic_marlin.yaml"
    facts = yaml.safe_load(data.read_text()) | changes
    path = folder / f"{name}.yaml"
    path.write_text(yaml.safe_dump(facts))
    return str(path)


@contextmanager
def answerer(record: Path) -> Iterator[str]:
    """The peer that only answers; gives its port. Its record is written at the end."""
    with _process(["-m", "benchmarks.link_answerer", str(record)]) as (process, port):
        yield port
        if process.stdin is not None:
            process.stdin.close()
        process.wait(60)


def read_record(path: Path) -> list[tuple[float, bytes]]:
    """What the answering peer took."""
    return [(when, text.encode("latin-1")) for when, text in json.loads(path.read_text())]


@contextmanager
def simulated(printer: str, *words: str) -> Iterator[str]:
    """The simulated printer as a process; gives its port."""
    start = ",".join(map(str, START_MM))
    with _process(["-m", "sim", "--printer", printer, "--start", start, *words]) as (process, port):
        yield port
        process.terminate()
        process.wait(30)


@contextmanager
def _process(words: list[str]) -> Iterator[tuple[subprocess.Popen[str], str]]:
    pipe = subprocess.PIPE
    with subprocess.Popen(
        [sys.executable, *words], cwd=ROOT, stdin=pipe, stdout=pipe, text=True
    ) as process:
        try:
            said = process.stdout.readline().strip() if process.stdout else ""
            if not said:
                raise PeerFailedError(f"{' '.join(words)} ended at once")
            yield process, said
        finally:
            process.kill()
