"""Read a user's files: bytes, G-code text, YAML checked by a model."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path
from typing import ClassVar, Final, Self

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError

from firmware_profiles.errors import wording
from firmware_profiles.yaml_file import read_yaml
from gcode.errors import GcodeError, SimError


class FileSection(BaseModel):
    """Base of a section of a user's YAML file: no unknown keys, no NaN or infinity."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class UserFile(FileSection):
    """Base of a user's YAML file.

    Attributes
    ----------
    called : str
        What the file is called in messages.
    error : type
        Of what `load` raises.
    """

    called: ClassVar[str]
    error: ClassVar[type[SimError]]

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read a file.

        Raises
        ------
        SimError
            `error`, when it can't be read, or has a key or value that means nothing.
        """
        try:
            return cls.model_validate(read_yaml(path.read_text(encoding="utf-8")) or {})
        except OSError as exc:
            raise cls.error(f"{cls.called} {path} can't be read: {exc.strerror}") from exc
        except (yaml.YAMLError, UnicodeDecodeError) as exc:
            raise cls.error(f"{cls.called} {path} isn't YAML: {exc}") from exc
        except ValidationError as exc:
            problems = "; ".join(
                f"{'.'.join(map(str, problem['loc'])) or 'file'}: {wording(problem)}"
                for problem in exc.errors()
            )
            raise cls.error(f"{cls.called} {path}: {problems}") from exc


_UTF_16: Final = (b"\xff\xfe", b"\xfe\xff")


def text_of(gcode: bytes) -> bytes:
    """Return the text of a file; raise `GcodeError` where it is binary or UTF-16."""
    if gcode.startswith(_UTF_16):
        raise GcodeError(
            "the G-code begins with UTF-16 text, which no printer reads; save it as plain text "
            "(UTF-8) in the editor"
        )
    at = gcode.find(b"\0")
    if at >= 0:
        line = gcode.count(b"\n", 0, at) + 1
        raise GcodeError(
            f"line {line} of the G-code has a NUL (byte {at}), as no text has: the file is binary "
            "or damaged; write it anew, or take the byte out in an editor"
        )
    return gcode.removeprefix(b"\xef\xbb\xbf")


def read_gcode_path(path: Path) -> bytes:
    """Read a regular file whole.

    Raises
    ------
    OSError
        When it can't be read, or is a folder, a pipe or a device, which may have no end; its
        ``strerror`` says which.
    """
    mode = path.stat().st_mode  # before it is opened: a pipe's opening waits for a writer
    if not stat.S_ISREG(mode):
        raise OSError(errno.EINVAL, f"it is {_kind(mode)} and no regular file", os.fspath(path))
    return path.read_bytes()


def _kind(mode: int) -> str:
    if stat.S_ISDIR(mode):
        return "a folder"
    return "a pipe" if stat.S_ISFIFO(mode) else "a device"
