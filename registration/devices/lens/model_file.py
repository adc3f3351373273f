"""Keep validated data models in YAML files; report a fault of one in a line with its remedy."""

from __future__ import annotations

from pathlib import Path
from typing import TypeVar

import yaml
from pydantic import BaseModel, ValidationError

from design.files import write_text
from firmware_profiles.yaml_file import read_yaml
from registration.errors import PictureError

Model = TypeVar("Model", bound=BaseModel)


def read_model(path: Path, model: type[Model], option: str, writer: str) -> Model:
    """Read a file.

    Parameters
    ----------
    path : Path
    model : type
        What it holds.
    option : str
        How the user named it.
    writer : str
        Command that writes such files.

    Raises
    ------
    PictureError
        When the file is missing, or isn't one.
    """
    remedy = f"`{writer}` writes one"
    try:
        return model.model_validate(read_yaml(path.read_text(encoding="utf-8")))
    except OSError as exc:
        raise PictureError(f"{option} {path} can't be read: {exc.strerror}; {remedy}") from exc
    except (yaml.YAMLError, UnicodeDecodeError) as exc:
        raise PictureError(f"{option} {path} isn't YAML ({exc}); {remedy}") from exc
    except ValidationError as exc:
        first = exc.errors()[0]
        place = ".".join(map(str, first["loc"])) or "the file"
        raise PictureError(f"{option} {path}: {place}: {first['msg']}; {remedy}") from exc


def write_model(path: Path, held: BaseModel) -> None:
    """Write a file that `read_model` reads back exactly, without what is None.

    Raises
    ------
    OSError
        When the disk is full or the folder can't be written.
    """
    data = held.model_dump(mode="json", exclude_none=True)
    write_text(path, yaml.safe_dump(data, sort_keys=False, default_flow_style=None, width=100))
