"""Command-line options made from a recipe's sections, or shared by several commands."""

from __future__ import annotations

import inspect
import re
import types
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from firmware_profiles.errors import wording
from printctl.cli.declare import keyword
from printctl.errors import UsageError
from printctl.recipe.parts import FILE
from printctl.settings import Declared, opt

Part = TypeVar("Part", bound=BaseModel)


@dataclass(frozen=True)
class SectionOptions:
    """Options that stand for the fields of one section.

    ``flag`` is the help of an option, named like the section, without which the section is left out
    and its other options are refused; empty where there is none.
    """

    model: type[BaseModel]
    at: tuple[str, ...] = ()  # keys that lead to it in the section that the command makes
    prefix: str = ""  # before each field's name
    renamed: Mapping[str, str] = field(default_factory=dict)  # options named otherwise, by field
    panel: str = ""  # heading in the help; the common one where it is empty
    flag: str = ""

    def fields(self) -> dict[str, str]:
        """Name of each option's field, by the option's name as a Python word."""
        return {
            self.renamed.get(key, self.prefix + key): key
            for key, info in self.model.model_fields.items()
            if _kind(info) is not None
        }

    def typed(self, requested: Mapping[str, Any]) -> dict[str, Any]:
        """Values of the fields whose options were given, by field.

        Raises `UsageError` for a file that isn't there, or an option without the section's flag.
        """
        given = {name: requested[name] for name in self.fields() if requested[name] is not None}
        if given and self.flag and not requested[self.at[-1]]:
            first = next(iter(given))
            word = f"no_{first}" if given[first] is False else first
            raise needs_another(word, self.at[-1])
        return {self.fields()[name]: _value(name, value) for name, value in given.items()}


@dataclass(frozen=True)
class Sections:
    """Options of several sections, as the default of a command's parameter (`declare.command`).

    The parameter gets the ``model``, made of what was typed; without one the words typed, by
    option. ``what`` is named where no single option is wrong.
    """

    groups: Sequence[SectionOptions]
    model: type[BaseModel] | None = None
    what: str = ""

    def parameters(self) -> list[inspect.Parameter]:
        """The options; all may be left out."""
        names = {
            key: name for one in self.groups for name, key in one.fields().items() if name == key
        }
        made = []
        for group in self.groups:
            panel = {"rich_help_panel": group.panel or None}
            if group.flag:
                made.append(keyword(group.at[-1], bool, opt(group.flag, False, **panel)))
            for name, key in group.fields().items():
                info = group.model.model_fields[key]
                declared = _declared(option(name), info, names, panel)
                made.append(keyword(name, _kind(info) | None, declared))
        return made

    def value(self, typed: dict[str, Any]) -> Any:
        """What the parameter gets; raises as `checked`."""
        return typed if self.model is None else self.checked(self.model, self.section(typed))

    def checked(self, model: type[Part], section: Mapping[str, Any]) -> Part:
        """The section as its model; raise `UsageError` for the first option that is wrong."""
        try:
            return model(**section)
        except ValidationError as exc:
            raise self._wrong(exc) from exc

    def section(self, requested: Mapping[str, Any]) -> dict[str, Any]:
        """What was typed, as a recipe's section would say it; raises as `SectionOptions.typed`."""
        section: dict[str, Any] = {}
        for group in self.groups:
            typed, place = group.typed(requested), section
            begun = typed or (group.flag and requested[group.at[-1]])
            for key in group.at if begun else ():
                place = place.setdefault(key, {})
            place |= typed
        return section

    def _wrong(self, exc: ValidationError) -> UsageError:
        first = exc.errors()[0]
        place = tuple(map(str, first["loc"]))
        names = {(*one.at, key): name for one in self.groups for name, key in one.fields().items()}
        if place not in names:
            same = {path[-1]: name for path, name in names.items() if path[-1] == name}
            where = ".".join(place) or self.what
            return UsageError(f"{where}: {_with_options(wording(first), same)}")
        stated = option(names[place])
        if first["type"] == "missing":
            return UsageError(f"{stated} {wording(first)}; give it")
        return UsageError(f"{stated}: {wording(first)} (is {first['input']!r})")


def needs_another(name: str, other: str) -> UsageError:
    """The refusal of an option that does nothing without another one."""
    return UsageError(f"{option(name)} is for {option(other)}; add that, or leave it out")


def option(name: str) -> str:
    """An option as it is typed, of its name as a Python word."""
    return "--" + name.replace("_", "-")


def _declared(
    word: str, info: FieldInfo, names: Mapping[str, str], panel: Mapping[str, Any]
) -> Declared:
    """The option of a field, whose default the help alone gives."""
    kind, default = _kind(info), info.get_default(call_default_factory=True)
    typed = f"{word}/--no-{word[2:]}" if kind is bool and default else word
    shown: str | bool = f"{default:g}" if isinstance(default, float) else str(default)
    if info.is_required() or default is None or kind is bool:
        shown = False
    text = _with_options(info.description or "", names)
    return opt(text, None, typed, show_default=shown, **panel)


def _with_options(words: str, names: Mapping[str, str]) -> str:
    """A field's description or refusal, naming options where it names fields."""
    return re.sub(
        r"\w+_\w+", lambda one: option(names[one[0]]) if one[0] in names else one[0], words
    )


def _kind(info: FieldInfo) -> Any:
    """Type of the option that stands for a field; None for what no single word says."""
    kind = _simple(info.annotation)
    return Path if kind is str and info.json_schema_extra == FILE else kind


def _simple(annotation: Any) -> Any:
    origin, args = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _simple(args[0])
    if origin in (Union, types.UnionType):
        members = [one for one in args if one is not type(None)]
        return _simple(members[0]) if len(members) == 1 else None
    if origin is Literal:
        return annotation if isinstance(args[0], str) else type(args[0])
    return annotation if annotation in (bool, float, int, str) else None


def _value(name: str, value: Any) -> Any:
    if not isinstance(value, Path):
        return value
    if not value.is_file():
        raise UsageError(f"{option(name)} {value} isn't there, or no file; check the path")
    return str(value.resolve())
