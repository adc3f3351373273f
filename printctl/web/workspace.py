"""Workspace folder of the web interface: locations of its files, and safe file names."""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Final

from printctl.machine.records.record import REHEARSAL
from printctl.run_folder.manifest import digest_file
from printctl.web.errors import BadRequestError, NotFoundError

Stamp = tuple[int, int]


def stamp(path: Path) -> Stamp:
    """Time of change, ns, and size of a file, bytes: what was read of it holds as long."""
    stat = path.stat()
    return stat.st_mtime_ns, stat.st_size


def file_hash(path: Path) -> str:
    """SHA-256 of a file, 64 hex digits; read again when its `stamp` is another.

    Raises
    ------
    OSError
        When the file can't be read.
    """
    return _hash(path, stamp(path))


@lru_cache(maxsize=256)
def _hash(path: Path, of: Stamp) -> str:
    return digest_file(path)


_LONGEST: Final = 64
"""Of a name, characters."""
_NAME: Final = re.compile(rf"[A-Za-z0-9][A-Za-z0-9._-]{{0,{_LONGEST - 1}}}")
_FOLDERS: Final = ("recipes", "runs", "jobs", "scans", "station", "records", ".printctl")


def is_name(name: str) -> bool:
    """Whether a name can be a file's anywhere and stays in its folder."""
    return bool(_NAME.fullmatch(name)) and not name.endswith(".") and ".." not in name


def checked_name(name: str) -> str:
    """Give ``name`` back if it `is_name`.

    Raises
    ------
    BadRequestError
    """
    if not is_name(name):
        raise BadRequestError(
            f"name {name[:80]!r} can't be used: 1 to 64 letters, digits, '.', '_' or '-', "
            "beginning with a letter or digit"
        )
    return name


def usable_name(file_name: str, default: str = "") -> str:
    """Return the name that an uploaded file is kept under: mein_Gefa_.stl for ``mein Gefäß.stl``.

    Folders before it and accents are dropped, the beginning of a long name is cut off.

    Parameters
    ----------
    file_name : str
        As the user's file is called.
    default : str
        In place of a name of which nothing is left but its suffix.

    Raises
    ------
    BadRequestError
        When nothing is left, and there is no ``default``.
    """
    last = file_name.replace("\\", "/").rpartition("/")[2]
    letters = (c for c in unicodedata.normalize("NFKD", last) if not unicodedata.combining(c))
    stem, dot, suffix = re.sub(r"[^A-Za-z0-9._-]+", "_", "".join(letters)).rpartition(".")
    if not dot:
        stem, suffix = suffix, ""
    end = f".{suffix}" if suffix else ""
    stem = re.sub(r"\.{2,}", ".", stem)[-(_LONGEST - len(end)) :].lstrip("._-").rstrip(".")
    return checked_name((stem or default) + end)


@dataclass(frozen=True)
class Workspace:
    """A folder of recipes, runs, jobs, scans and prints."""

    root: Path

    def make(self) -> Workspace:
        """Make the folders that are missing; a new workspace is its user's alone."""
        self.root.mkdir(0o700, parents=True, exist_ok=True)
        for name in _FOLDERS:
            (self.root / name).mkdir(parents=True, exist_ok=True)
        (self.root / ".printctl").chmod(0o700)
        return self

    @property
    def station(self) -> Path:
        """Folder of the printer's station."""
        return self.root / "station"

    @property
    def private(self) -> Path:
        """Folder of what only the server reads: tokens, caches."""
        return self.root / ".printctl"

    def inside(self, path: Path) -> Path:
        """Give back a path of the workspace that may be opened, or made.

        It mustn't be a link that leads out of the workspace. A folder of the workspace may be one
        as a whole: ``scans`` on another disk.

        Raises
        ------
        BadRequestError
        """
        if reason := self._unusable(path):
            raise BadRequestError(f"{path.name} can't be used: {reason}")
        return path

    def found(self, pattern: str) -> list[Path]:
        """Return the files and folders of a pattern that may be opened."""
        return [path for path in self.root.glob(pattern) if not self._unusable(path)]

    def _unusable(self, path: Path) -> str:
        if path.exists() and not (path.is_file() or path.is_dir()):
            return "it is neither a file nor a folder, and reading it may never end; remove it"
        try:
            real = path.resolve()
        except (OSError, RuntimeError):
            return f"{path.name} is a link that leads to itself; remove it"
        folders = (self.root, path.parent)
        if real == path or any(real.is_relative_to(one.resolve()) for one in folders):
            return ""
        return (
            f"{path.name} is a link that leads outside the workspace {self.root}, which isn't "
            "followed; put a copy in its place"
        )

    def recipe(self, name: str) -> Path:
        """Recipe file of a name, which may not exist."""
        return self.inside(self.root / "recipes" / f"{checked_name(name)}.yaml")

    def run(self, name: str) -> Path:
        """Run folder of a name, or of its rehearsal, which may not exist."""
        checked_name(name.removesuffix(REHEARSAL))
        return self.inside(self.root / "runs" / name)

    def job_file(self, job: str) -> Path:
        """G-code file of a job: ``run~NAME`` (a run's part.gcode) or ``file~NAME`` (uploaded).

        Raises
        ------
        BadRequestError, NotFoundError
        """
        sort, _, name = job.partition("~")
        if sort == "run":
            path = self.run(name) / "part.gcode"
        elif sort == "file":
            path = self.root / "jobs" / checked_name(name)
        else:
            raise BadRequestError(f"job {job[:80]!r} is neither run~NAME nor file~NAME")
        if not self.inside(path).is_file():
            raise NotFoundError(f"there is no job {job!r} in {self.root}")
        return path

    def print_folder(self, job: str) -> Path:
        """Where the journal of a job's print goes."""
        path = self.job_file(job)
        run = job.startswith("run~")
        return self.inside(path.parent / "print" if run else path.with_name(path.name + ".print"))

    def jobs(self) -> list[str]:
        """Every job whose name can be used, the newest file first."""
        files = [("run", path.parent.name, path) for path in self.found("runs/*/part.gcode")]
        files += [("file", path.name, path) for path in self.found("jobs/*.gcode")]
        files = [one for one in files if is_name(one[1]) and one[2].is_file()]
        files.sort(key=lambda one: one[2].stat().st_mtime, reverse=True)
        return [f"{sort}~{name}" for sort, name, _ in files]

    def unusable_names(self, *patterns: str) -> list[str]:
        """Files and folders of patterns that no page shows before they are renamed, sorted.

        Hidden ones are none of the user's.
        """
        return sorted(
            path.relative_to(self.root).as_posix().encode(errors="backslashreplace").decode()
            for pattern in patterns
            for path in self.found(pattern)
            if not is_name(path.stem if path.suffix == ".yaml" else path.name)
            and not path.name.startswith(".")
        )
