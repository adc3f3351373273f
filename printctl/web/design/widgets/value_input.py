"""Input widget for one value of a recipe."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Any

from nicegui import ui
from nicegui.elements.mixins.validation_element import ValidationElement
from nicegui.events import ValueChangeEventArguments

from printctl.web.design.checking import PROFILES
from printctl.web.design.recipes import Recipes
from printctl.web.design.schema import FormField, Node
from printctl.web.design.widgets.field_text import hint, input_text, label, parse_typed, placeholder

Say = Callable[[Any], Awaitable[None]]
"""Told of a new value; None for the default."""

_DEFAULT = "\0default"
_YES_NO = {True: "yes", False: "no"}


def leaf(
    field: FormField, value: Any, say: Say, recipes: Recipes, name: str = ""
) -> ValidationElement[Any]:
    """An input that shows a value, or its default, and says what is made of it.

    Parameters
    ----------
    field : FormField
    value : JSON value
        None where nothing is said.
    say : function
    recipes : Recipes
        They know the profiles and files that can be chosen.
    name : str
        In place of the field's label.
    """
    if field.node.sort in ("one_of", "profile", "flag", "file"):
        element = _choice(field, value, say, recipes, name or label(field))
    else:
        element = _text(field, value, say, name or label(field))
    words = hint(field)
    if words:
        element.props["hint"] = words
    return element


def _text(field: FormField, value: Any, say: Say, name: str) -> ValidationElement[Any]:
    async def changed(event: ValueChangeEventArguments[str | None]) -> None:
        text = event.value or ""
        await say(None if not text.strip() else parse_typed(field.node, text))

    element = ui.input(
        name, value=input_text(field.node, value), placeholder=placeholder(field), on_change=changed
    )
    element.props("outlined dense stack-label debounce=450").classes("pc-field")
    if field.node.sort == "number":
        element.props("inputmode=decimal")
    return element


def _choice(
    field: FormField, value: Any, say: Say, recipes: Recipes, name: str
) -> ValidationElement[Any]:
    known = {_key(one): (one, word) for one, word in _values(field.node, recipes)}
    options = {_DEFAULT: f"{placeholder(field)} (default)"} if not field.required else {}
    options |= {key: word for key, (_, word) in known.items()}
    now = _DEFAULT if value is None else _key(value)
    if now not in options:
        options[now] = str(value) if value is not None else "to be given"

    async def changed(event: ValueChangeEventArguments[str | None]) -> None:
        chosen = event.value or _DEFAULT
        await say(known[chosen][0] if chosen in known else None)

    element = ui.select(options, label=name, value=now, on_change=changed)
    element.props("outlined dense stack-label options-dense").classes("pc-field")
    return element


def _values(node: Node, recipes: Recipes) -> list[tuple[Any, str]]:
    """Each with its word."""
    if node.sort in ("flag", "one_of"):
        plain = (True, False) if node.sort == "flag" else node.values
        return [(one, _YES_NO[one] if isinstance(one, bool) else str(one)) for one in plain]
    if node.sort == "file":
        return [(one, one) for one in recipes.files()]
    return list(recipes.store.choices(PROFILES[node.profile]).items())


def _key(value: Any) -> str:
    return f"{type(value).__name__}:{value}"
