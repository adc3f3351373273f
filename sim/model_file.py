"""Read a YAML file into a checked model, with one message for all that is wrong in it."""

from __future__ import annotations

from pathlib import Path
from typing import TypeVar

import yaml
from pydantic import BaseModel, ValidationError

from firmware_profiles.wrong_values import wording
from firmware_profiles.yaml_file import read_yaml
from sim.errors import SimError

Model = TypeVar("Model", bound=BaseModel)


def read_model(path: Path, model: type[Model], what: str, error: type[SimError]) -> Model:
    """Return what a YAML file says.

    Parameters
    ----------
    path : Path
    model : type
        Of which it is one.
    what : str
        What the file is called in messages.
    error : type
        Of what is raised.

    Raises
    ------
    SimError
        `error`, when it can't be read, or has a key or value that means nothing.
    """
    try:
        return model.model_validate(read_yaml(path.read_text(encoding="utf-8")) or {})
    except OSError as exc:
        raise error(f"{what} {path} can't be read: {exc.strerror}") from exc
    except (yaml.YAMLError, UnicodeDecodeError) as exc:
        raise error(f"{what} {path} isn't YAML: {exc}") from exc
    except ValidationError as exc:
        problems = "; ".join(
            f"{'.'.join(map(str, problem['loc'])) or 'file'}: {wording(problem)}"
            for problem in exc.errors()
        )
        raise error(f"{what} {path}: {problems}") from exc
