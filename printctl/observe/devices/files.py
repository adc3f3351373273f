"""Get a picture from a watched folder, an external command or the simulated camera; copy it."""

from __future__ import annotations

import shlex
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Final

from printctl.observe.devices.settings import DeviceSettings

_STILL_S: Final = 0.5
"""A file that hasn't grown for so long is whole."""
_LOOK_S: Final = 0.1
Listing = dict[str, tuple[int, int]]
"""Names of files, with the time of each (ns, by whatever clock) and its size."""
_SIDECARS: Final = (".json", ".yaml", ".yml")
"""Endings of what a scan's file is described by (`registration.files.readers.sidecar`)."""
_BESIDE: Final = frozenset({*_SIDECARS, ".txt", ".xml", ".log", ".csv", ".tmp", ".part"})
"""Endings of files that devices' programs write beside a picture or volume."""
_TABLES: Final = frozenset({".txt", ".csv"})
"""Those of them that a laser profiler's points or heights may have."""


def picture_of(folder: Path, name: str) -> Path | None:
    """Return the picture or volume ``NAME.*``, not what lies beside it; None where there is none.

    A raw volume may lack an ending, and a laser's sweep may be a folder of pictures. A table counts
    where there is nothing else.
    """
    each = sorted(one for one in folder.glob(f"{name}*") if one.is_file() or _holds_files(one))
    named = [one for one in each if one.name == name or one.name.startswith(f"{name}.")]
    for beside in (_BESIDE, _BESIDE - _TABLES):
        if found := [one for one in named if one.suffix.lower() not in beside]:
            return found[0]
    return None


def keep_file(taken: Path, out: Path) -> Path:
    """Copy a device's file or folder into a look's folder, with its sidecar; its ending stays.

    The device's program may write the next one over it.

    Parameters
    ----------
    taken : Path
    out : Path
        Without suffix.
    """
    for ending in _SIDECARS:
        beside = taken.with_suffix(ending)
        if beside.is_file():
            shutil.copyfile(beside, out.with_suffix(ending))
    if taken.is_dir():
        return Path(shutil.copytree(taken, out, dirs_exist_ok=True))
    return Path(shutil.copyfile(taken, out.with_suffix(taken.suffix)))


def files_in(folder: Path, tables: bool = False) -> Listing:
    """List a folder's pictures and volumes with the time and size of each.

    With ``tables`` also a laser line's tables of numbers, and folders of a sweep's pictures.

    Raises
    ------
    ValueError
        When the folder isn't there.
    """
    if not folder.is_dir():
        raise ValueError(f"folder {folder} isn't there; let the device's program write into it")
    listed: Listing = {}
    beside = _BESIDE - _TABLES if tables else _BESIDE
    for one in folder.iterdir():
        if one.name.startswith(".") or one.suffix.lower() in beside:
            continue
        if one.is_file():
            known = one.stat()
            listed[one.name] = (known.st_mtime_ns, known.st_size)
        elif tables and _holds_files(one):
            each = [file.stat() for file in one.iterdir()]
            latest = max(known.st_mtime_ns for known in each)
            listed[one.name] = (latest, sum(known.st_size for known in each))
    return listed


def _holds_files(folder: Path) -> bool:
    return folder.is_dir() and any(one.is_file() for one in folder.iterdir())


def await_file(folder: Path, before: Listing, tables: bool = False) -> Path:
    """Wait for a new file in a folder, until it grows no more; the caller limits the time.

    Parameters
    ----------
    folder : Path
    before : dict
        What was there before, of `files_in`: the clock that dates the files may be another
        computer's.
    tables : bool
        Whether a `.csv` or `.txt`, or a folder of pictures, may be what is waited for.

    Raises
    ------
    ValueError
        When the folder isn't there.
    """
    found, at = ("", (0, 0)), time.monotonic()
    while True:
        new = files_in(folder, tables).items() - before.items()
        latest = max(new, key=lambda one: (one[1], one[0]), default=("", (0, 0)))
        if latest != found:
            found, at = latest, time.monotonic()
        elif found[1][1] > 0 and time.monotonic() - at >= _STILL_S:
            return folder / found[0]
        time.sleep(_LOOK_S)


def run_command(words: str, out: Path) -> Path:
    """Run a device's own program, which writes the file that ``{out}`` names.

    Raises
    ------
    ValueError
        When it fails, or writes nothing.
    """
    if "{out}" not in words:
        raise ValueError("the device's command doesn't say {out}, the file that it is to write")
    command = [word.replace("{out}", str(out)) for word in shlex.split(words)]
    done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, check=False)
    if done.returncode:
        last = done.stderr.decode(errors="replace").strip().splitlines()[-1:] or ["no message"]
        raise ValueError(f"{command[0]} failed ({done.returncode}): {last[0]}")
    written = picture_of(out.parent, out.name)
    if written is None:
        raise ValueError(f"{command[0]} wrote no file {out}")
    return written


def simulated_picture(settings: DeviceSettings, out: Path) -> Path:
    """Paint what lies in the simulated dish.

    Raises
    ------
    ValueError
        When nothing was recorded yet.
    """
    device = next(one for one in ("oct", "laser_line", "camera") if one in settings.extra)
    path = out.with_suffix(".png" if device == "camera" else ".npz")
    look = 2 * int(out.parent.name) + (out.name != "picture")  # another noise in each picture
    command = [sys.executable, "-m", "sim", device, "--out", str(path), "--look", str(look)]
    for name, value in settings.extra.items():
        command += [f"--{name}={value}"]  # a place may begin with a minus
    done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, check=False)
    if done.returncode:
        last = done.stderr.decode(errors="replace").strip().splitlines()[-1:] or ["no message"]
        raise ValueError(f"the simulated {device} failed: {last[0]}")
    return path
