"""Acquire in a process of its own, and end it at its time limit."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from printctl.errors import PrintctlError
from printctl.observe.devices.settings import DeviceSettings


class DeviceError(PrintctlError):
    """A device gave no picture: it is missing, refuses, or hangs."""


def acquire(settings: DeviceSettings, out: Path, since: float) -> Path:
    """Take one picture or volume.

    Parameters
    ----------
    settings : DeviceSettings
    out : Path
        File to write, without suffix: the device's own format decides.
    since : float, s since 1970
        Of a folder only files count that are newer.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    DeviceError
        When there is none within the limit; the message says why and what to do.
    """
    command = [sys.executable, "-m", "printctl.observe.devices", settings.to_json(), str(out)]
    try:
        done = subprocess.run(
            [*command, f"{since:.3f}"],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=settings.limit_s,
            check=False,
        )
    except subprocess.TimeoutExpired as exc:
        raise DeviceError(
            f"the {settings.kind} gave no picture within {settings.limit_s:g} s; is it connected, "
            "switched on and free (no other program)?"
        ) from exc
    said = done.stdout.strip().splitlines()
    if done.returncode or not said:
        why = done.stderr.strip().splitlines()
        raise DeviceError(why[-1] if why else f"the {settings.kind} failed without a word")
    return Path(said[-1])
