"""Acquire one picture or volume in a subprocess, ended at its time limit."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

from printctl.errors import PrintctlError
from printctl.observe.devices.files import files_in
from printctl.observe.devices.settings import DeviceSettings

Place = tuple[float, float, float]
Region = tuple[Place, Place]


class DeviceError(PrintctlError):
    """A device gave no picture: it is missing, refuses, or hangs."""


def acquire(settings: DeviceSettings, out: Path, region: Region | None = None) -> Path:
    """Take one picture or volume; of a folder a file that isn't in it yet.

    Parameters
    ----------
    settings : DeviceSettings
    out : Path
        File to write, without suffix: the device's own format decides.
    region : (low, high), each (x, y, z), mm, optional
        Box of the printer's frame that is looked at: a simulated OCT or laser line scans no more.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    DeviceError
        When there is none within the limit; the message says why and what to do.
    """
    if region is not None and settings.kind == "simulated":
        low, high = (",".join(f"{value:.4f}" for value in corner) for corner in region)
        settings = replace(settings, extra={**settings.extra, "low": low, "high": high})
    before = _files_before(settings)
    process = subprocess.Popen(
        [sys.executable, "-m", "printctl.observe.devices", settings.to_json(), str(out)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
        start_new_session=True,
    )
    try:
        said, why = process.communicate(before, timeout=settings.limit_s)
    except subprocess.TimeoutExpired as exc:
        raise DeviceError(_late(settings)) from exc
    finally:
        _end(process)
    if process.returncode or not said.strip():
        last = why.strip().splitlines()
        raise DeviceError(last[-1] if last else f"the {settings.kind} failed without a word")
    return Path(said.strip().splitlines()[-1])


def _late(settings: DeviceSettings) -> str:
    """Say that there was no picture within the limit."""
    if settings.kind == "folder":
        return (
            f"no new picture came into {settings.source} within {settings.limit_s:.3g} s; the "
            "device's program writes one at each look, and another where something is missing in "
            "it: is it running?"
        )
    return (
        f"the {settings.kind} gave no picture within {settings.limit_s:.3g} s; is it connected, "
        "switched on and free (no other program)?"
    )


def _files_before(settings: DeviceSettings) -> str:
    """What is in a device's folder before its picture is waited for, as JSON."""
    if settings.kind != "folder":
        return ""
    try:
        return json.dumps(files_in(Path(settings.source), settings.tables))
    except (OSError, ValueError) as exc:
        raise DeviceError(str(exc)) from exc


def _end(process: subprocess.Popen[str]) -> None:
    """End a process, and a device's own program that it has started."""
    if process.poll() is not None:
        return
    if hasattr(os, "killpg"):
        os.killpg(process.pid, signal.SIGKILL)
    process.kill()
    process.communicate()  # closes its pipes
