"""All sorts of profiles by name, and the sort of a profile that only its name or file tells."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final

from firmware_profiles.errors import ProfileError
from firmware_profiles.load import load, read_keys, shipped
from firmware_profiles.materials.inks_and_baths import Bath, Ink
from firmware_profiles.plates import Dish, Plate
from firmware_profiles.printers import Printer
from firmware_profiles.strict_model import Facts
from firmware_profiles.tools import Needle, Syringe

PROFILE_SORTS: Final[Mapping[str, type[Facts]]] = {
    "printer": Printer,
    "needle": Needle,
    "syringe": Syringe,
    "ink": Ink,
    "bath": Bath,
    "dish": Dish,
    "plate": Plate,
}


def find_profile(name: str) -> tuple[str, Facts]:
    """Sort and facts of a shipped name or of a file, which itself doesn't say its sort.

    Raises
    ------
    ProfileError
        When there is none; of a file that is no profile it says what the sort wants whose keys
        it has most of.
    """
    if not name.endswith((".yaml", ".yml")):
        for kind, model in PROFILE_SORTS.items():
            if name in shipped(model):
                return kind, load(model, name)
        raise ProfileError(
            f"no profile {name!r}; `printctl profiles` lists the shipped ones, a file of your own "
            "ends in .yaml"
        )
    if not Path(name).is_file():
        raise ProfileError(f"profile file {name} doesn't exist; check the path")
    kind = _likeliest(name)
    return kind, load(PROFILE_SORTS[kind], name)


def _likeliest(file: str) -> str:
    """The sort of profile that most of a file's keys belong to."""
    keys = set(read_keys(file)) - set(Facts.model_fields)
    shared = {kind: len(keys & set(model.model_fields)) for kind, model in PROFILE_SORTS.items()}
    kind = max(shared, key=lambda one: shared[one])
    if not shared[kind]:
        raise ProfileError(
            f"{file} has no key of any sort of profile ({', '.join(PROFILE_SORTS)}); "
            "`printctl profiles NAME` shows a shipped one with all its keys"
        )
    return kind
