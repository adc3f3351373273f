"""An input for one value of a recipe."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Any

from nicegui import ui
from nicegui.elements.mixins.validation_element import ValidationElement
from nicegui.events import ValueChangeEventArguments

from firmware_profiles import shipped
from printctl.web.design.checking import PROFILES
from printctl.web.design.pane.words import hint, label, placeholder, shown, typed
from printctl.web.design.schema import FormField, Node

Say = Callable[[Any], Awaitable[None]]
"""Told of a new value; None for the default."""

_DEFAULT = "\0default"


def leaf(field: FormField, value: Any, say: Say, name: str = "") -> ValidationElement[Any]:
    """An input that shows a value, or its default, and says what is made of it.

    Parameters
    ----------
    field : FormField
    value : JSON value
        None where nothing is said.
    say : function
    name : str
        In place of the field's label.
    """
    if field.node.sort in ("one_of", "profile", "flag"):
        element = _choice(field, value, say, name or label(field))
    else:
        element = _text(field, value, say, name or label(field))
    words = hint(field)
    if words:
        element.props["hint"] = words
    return element


def _text(field: FormField, value: Any, say: Say, name: str) -> ValidationElement[Any]:
    async def changed(event: ValueChangeEventArguments[str | None]) -> None:
        text = event.value or ""
        await say(None if not text.strip() else typed(field.node, text))

    element = ui.input(
        name, value=shown(field.node, value), placeholder=placeholder(field), on_change=changed
    )
    element.props("outlined dense stack-label debounce=450").classes("pc-field")
    if field.node.sort == "number":
        element.props("inputmode=decimal")
    return element


def _choice(field: FormField, value: Any, say: Say, name: str) -> ValidationElement[Any]:
    options = {_DEFAULT: f"{placeholder(field)} (default)"} if not field.required else {}
    options |= {_key(one): str(_word(one)) for one in _values(field.node)}
    now = _DEFAULT if value is None else _key(value)
    if now not in options:
        options[now] = str(value) if value is not None else "to be given"

    async def changed(event: ValueChangeEventArguments[str | None]) -> None:
        chosen = event.value or _DEFAULT
        values = {_key(one): one for one in _values(field.node)}
        await say(values.get(chosen))

    element = ui.select(options, label=name, value=now, on_change=changed)
    element.props("outlined dense stack-label options-dense").classes("pc-field")
    return element


def _values(node: Node) -> list[Any]:
    if node.sort == "flag":
        return [True, False]
    return list(node.values) if node.sort == "one_of" else shipped(PROFILES[node.profile])


def _word(value: Any) -> Any:
    return {True: "yes", False: "no"}[value] if isinstance(value, bool) else value


def _key(value: Any) -> str:
    return f"{type(value).__name__}:{value}"
