"""Acquire a picture or volume from a camera, folder, command or simulated printer.

`python -m printctl.observe.devices SETTINGS OUT` acquires one picture and prints its path; what a
folder held before is read from standard input. It ends with the process that started it, and so
does the device's own program.
"""

from __future__ import annotations

import json
import os
import shlex
import shutil
import subprocess
import sys
import threading
import time
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Final, Literal

from printctl.errors import PrintctlError
from printctl.processes.alive import KILL, has_groups, send_signal
from printctl.sources import python_command

PICTURE_TIME_SHARE: Final = 0.8
"""Share of a look's time limit in which its pictures are taken: the rest is judgement's."""
Kind = Literal["camera", "folder", "command", "simulated"]


@dataclass(frozen=True)
class DeviceSettings:
    """Settings to acquire one picture or volume.

    Attributes
    ----------
    kind : "camera", "folder", "command" or "simulated"
    source : str
        Of a camera its number or address; of a folder its path; of a command its words.
    size_px : tuple of int or None
        Width and height requested of a camera; None for its own.
    limit_s : float, s
        After which it counts as hung.
    extra : dict
        What one kind alone needs: of ``simulated`` the ``record``, ``faults`` and ``camera`` files.
    tables : bool
        Whether its files may be tables of numbers (`.csv`, `.txt`), as a laser profiler's, or
        folders of pictures, as a laser line's with a camera.
    """

    kind: Kind
    source: str = ""
    size_px: tuple[int, int] | None = None
    limit_s: float = 20.0
    extra: dict[str, Any] = field(default_factory=dict)
    tables: bool = False

    def to_json(self) -> str:
        """Return the settings as JSON text."""
        return json.dumps(asdict(self))

    @staticmethod
    def from_json(text: str) -> DeviceSettings:
        """Read settings from the text of `to_json`."""
        data = json.loads(text)
        size = data["size_px"]
        return DeviceSettings(**{**data, "size_px": tuple(size) if size else None})


_SETTLING_FRAMES: Final = 8
"""First pictures are dropped: exposure and white balance settle, and buffers hold old ones."""


def take_picture(settings: DeviceSettings, out: Path) -> Path:
    """Take a picture and write it as PNG.

    Raises
    ------
    ValueError
        When the camera can't be opened, gives nothing, or another size than requested.
    """
    import cv2  # only the process that takes a picture needs it

    source = settings.source or "0"
    camera = cv2.VideoCapture(int(source) if source.isdigit() else source)
    try:
        if not camera.isOpened():
            raise ValueError(f"camera {source} can't be opened; is it connected, and free?")
        if settings.size_px is not None:
            camera.set(cv2.CAP_PROP_FRAME_WIDTH, settings.size_px[0])
            camera.set(cv2.CAP_PROP_FRAME_HEIGHT, settings.size_px[1])
        read = False
        for _ in range(_SETTLING_FRAMES):
            read, image = camera.read()
    finally:
        camera.release()
    if not read or image is None:
        raise ValueError(f"camera {source} gave no picture; is another program using it?")
    size = (image.shape[1], image.shape[0])
    if settings.size_px is not None and size != settings.size_px:
        raise ValueError(
            f"camera {source} gives {size[0]} x {size[1]} px, and its lens was calibrated at "
            f"{settings.size_px[0]} x {settings.size_px[1]}; calibrate it at a size that it gives"
        )
    path = out.with_suffix(".png")
    if not cv2.imwrite(str(path), image):
        raise ValueError(f"{path} can't be written; is the disk full?")
    return path


_UNCHANGED_S: Final = 0.5
"""A file that hasn't grown for so long is whole."""
_POLL_S: Final = 0.1
Listing = dict[str, tuple[int, int]]
"""Names of files, with the time of each (ns, by whatever clock) and its size."""
_SIDECAR_SUFFIXES: Final = (".json", ".yaml", ".yml")
"""Endings of what a scan's file is described by (`registration.files.readers.metadata`)."""
_COMPANION_SUFFIXES: Final = frozenset(
    {*_SIDECAR_SUFFIXES, ".txt", ".xml", ".log", ".csv", ".tmp", ".part"}
)
"""Endings of files that devices' programs write beside a picture or volume."""
_TABLE_SUFFIXES: Final = frozenset({".txt", ".csv"})
"""Those of them that a laser profiler's points or heights may have."""


def find_picture(folder: Path, name: str) -> Path | None:
    """Return the picture or volume ``NAME.*``, not what lies beside it; None where there is none.

    A raw volume may lack an ending, and a laser's sweep may be a folder of pictures. A table counts
    where there is nothing else.
    """
    each = sorted(one for one in folder.glob(f"{name}*") if one.is_file() or _holds_files(one))
    named = [one for one in each if one.name == name or one.name.startswith(f"{name}.")]
    for beside in (_COMPANION_SUFFIXES, _COMPANION_SUFFIXES - _TABLE_SUFFIXES):
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
    for ending in _SIDECAR_SUFFIXES:
        beside = taken.with_suffix(ending)
        if beside.is_file():
            shutil.copyfile(beside, out.with_suffix(ending))
    if taken.is_dir():
        return Path(shutil.copytree(taken, out, dirs_exist_ok=True))
    return Path(shutil.copyfile(taken, out.with_suffix(taken.suffix)))


def list_files(folder: Path, tables: bool = False) -> Listing:
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
    beside = _COMPANION_SUFFIXES - _TABLE_SUFFIXES if tables else _COMPANION_SUFFIXES
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
        What was there before, of `list_files`: the clock that dates the files may be another
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
        new = list_files(folder, tables).items() - before.items()
        latest = max(new, key=lambda one: (one[1], one[0]), default=("", (0, 0)))
        if latest != found:
            found, at = latest, time.monotonic()
        elif found[1][1] > 0 and time.monotonic() - at >= _UNCHANGED_S:
            return folder / found[0]
        time.sleep(_POLL_S)


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
    written = find_picture(out.parent, out.name)
    if written is None:
        raise ValueError(f"{command[0]} wrote no file {out}")
    return written


def simulated_picture(settings: DeviceSettings, out: Path) -> Path:
    """Render the simulated dish to a file.

    Raises
    ------
    ValueError
        When nothing was recorded yet.
    """
    device = next(one for one in ("oct", "laser_line", "camera") if one in settings.extra)
    path = out.with_suffix(".png" if device == "camera" else ".npz")
    look = 2 * int(out.parent.name) + (out.name != "picture")  # another noise in each picture
    command = [*python_command("sim"), device, "--out", str(path), "--look", str(look)]
    for name, value in settings.extra.items():
        command += [f"--{name}={value}"]  # a place may begin with a minus
    done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, check=False)
    if done.returncode:
        last = done.stderr.decode(errors="replace").strip().splitlines()[-1:] or ["no message"]
        raise ValueError(f"the simulated {device} failed: {last[0]}")
    return path


Place = tuple[float, float, float]
Region = tuple[Place, Place]


class DeviceError(PrintctlError):
    """Failure of a device to give a usable picture: missing, refusing or hanging."""


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
    before = _list_earlier_files(settings)
    process = subprocess.Popen(
        [*python_command("printctl.observe.devices"), settings.to_json(), str(out)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
        start_new_session=True,
    )
    try:
        output, why = process.communicate(before, timeout=settings.limit_s)
    except subprocess.TimeoutExpired as exc:
        raise DeviceError(_timeout_message(settings)) from exc
    finally:
        _kill(process)
    if process.returncode or not output.strip():
        last = why.strip().splitlines()
        raise DeviceError(last[-1] if last else f"the {settings.kind} failed without a word")
    return Path(output.strip().splitlines()[-1])


def _timeout_message(settings: DeviceSettings) -> str:
    """Return the message that no picture came within the limit."""
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


def _list_earlier_files(settings: DeviceSettings) -> str:
    """Return the files in a device's folder before acquisition, as JSON."""
    if settings.kind != "folder":
        return ""
    try:
        return json.dumps(list_files(Path(settings.source), settings.tables))
    except (OSError, ValueError) as exc:
        raise DeviceError(str(exc)) from exc


def _kill(process: subprocess.Popen[str]) -> None:
    """End a process, and a device's own program that it has started."""
    if process.poll() is not None:
        return
    send_signal(process.pid, KILL, group=True)
    process.kill()
    process.communicate()  # closes its pipes


# A folder's earlier files are read from standard input. It ends with the process
# that started it, and so does the device's own program.
_PARENT_POLL_S: Final = 0.2


def main() -> int:
    """Acquire one picture; return 1 and print one line to stderr if that fails."""
    if has_groups():  # elsewhere a process can't learn that its parent is gone
        threading.Thread(target=_end_with_parent, args=(os.getppid(),), daemon=True).start()
    settings, out = DeviceSettings.from_json(sys.argv[1]), Path(sys.argv[2])
    try:
        if settings.kind == "camera":
            picture = take_picture(settings, out)
        elif settings.kind == "folder":
            listing = json.load(sys.stdin).items()
            before = {name: (int(at), int(size)) for name, (at, size) in listing}
            taken = await_file(Path(settings.source), before, settings.tables)
            picture = keep_file(taken, out)
        elif settings.kind == "command":
            picture = run_command(settings.source, out)
        else:
            picture = simulated_picture(settings, out)
    except (OSError, ValueError) as exc:
        print(" ".join(str(exc).split()), file=sys.stderr)
        return 1
    print(picture)
    return 0


def _end_with_parent(parent: int) -> None:
    """End this process group once its parent is gone, so that no scan disturbs the next."""
    while os.getppid() == parent:
        time.sleep(_PARENT_POLL_S)
    if os.getpgrp() == os.getpid():
        send_signal(os.getpid(), KILL, group=True)
    os._exit(1)


if __name__ == "__main__":
    sys.exit(main())
