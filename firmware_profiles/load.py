"""Load and check a profile, by name from the shipped ones or from the user's YAML file."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final, TypeVar

import yaml
from pydantic import ValidationError

from firmware_profiles.errors import ProfileError, refuse
from firmware_profiles.materials.inks_and_baths import Bath, Ink
from firmware_profiles.plates import Dish, Plate
from firmware_profiles.printers import Printer
from firmware_profiles.strict_model import Facts
from firmware_profiles.tools import Needle, Syringe
from firmware_profiles.yaml_file import read_yaml

Profile = TypeVar("Profile", bound=Facts)

DATA: Final = Path(__file__).resolve().parent / "data"
FOLDERS: Final[dict[type[Facts], str]] = {
    Printer: "printers",
    Needle: "needles",
    Syringe: "syringes",
    Ink: "inks",
    Bath: "baths",
    Dish: "dishes",
    Plate: "plates",
}


def shipped(model: type[Facts]) -> list[str]:
    """Names of the shipped profiles of one sort, sorted."""
    return sorted(path.stem for path in (DATA / FOLDERS[model]).glob("*.yaml"))


def load(model: type[Profile], name: str) -> Profile:
    """Load a profile by shipped name, or by path when ``name`` ends in ``.yaml``.

    Raises
    ------
    ProfileError
        When there is no such profile, a key is unknown or a value out of its bounds.
    """
    path = Path(name) if name.endswith((".yaml", ".yml")) else _shipped_path(model, name)
    try:
        return model.model_validate(_read(path))
    except ValidationError as exc:
        raise ProfileError(refuse(exc, model, path.name)) from exc


def read_keys(file: str) -> list[str]:
    """Keys of a profile's file, whatever its sort.

    Raises
    ------
    ProfileError
        When it can't be read or holds no keys.
    """
    data = _read(Path(file))
    if not isinstance(data, dict):
        raise ProfileError(f"{file} holds no keys; a profile is `key: value`, one a line")
    return [str(key) for key in data]


def _read(path: Path) -> Any:
    try:
        return read_yaml(path.read_text(encoding="utf-8"))
    except FileNotFoundError as exc:
        raise ProfileError(f"profile file {path} doesn't exist; check the path") from exc
    except (yaml.YAMLError, UnicodeDecodeError) as exc:
        raise ProfileError(f"{path} isn't YAML: {exc}") from exc


def shipped_text(model: type[Facts], name: str) -> str:
    """Text of a shipped profile's file, with its comments.

    Raises
    ------
    ProfileError
        When there is no such profile.
    """
    return _shipped_path(model, name).read_text(encoding="utf-8")


def _shipped_path(model: type[Facts], name: str) -> Path:
    names = shipped(model)
    if name not in names:
        raise ProfileError(
            f"no {model.__name__.lower()} profile {name!r}; shipped: {', '.join(names)}; "
            "or give the path of a .yaml file of your own"
        )
    return DATA / FOLDERS[model] / f"{name}.yaml"
