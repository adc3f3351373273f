"""The form's pane on the page: a widget for each kind of field."""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable
from dataclasses import replace
from typing import Any, Final

import yaml
from nicegui import events, ui
from nicegui.elements.mixins.validation_element import ValidationElement
from nicegui.events import ValueChangeEventArguments

from firmware_profiles.yaml_file import read_yaml
from printctl.web.design import form as forms
from printctl.web.design.editor import Editor
from printctl.web.design.embed import embed, make_in_thread
from printctl.web.design.form import PickTarget, pick_targets
from printctl.web.design.recipes import PROFILES, Recipes
from printctl.web.design.schema import FormField, Node
from printctl.web.design.service import DesignService
from printctl.web.errors import WebError
from printctl.web.shell.frame import run_or_notify


def parse_typed(node: Node, text: str) -> Any:
    """Parse typed text; what isn't a number stays text, and the check reports it."""
    text = text.strip()
    if node.sort == "number":
        return _number(text)
    if node.sort in ("list", "row", "free"):
        return _value(text, node.sort)
    return text


def input_text(node: Node, value: Any) -> str:
    """What an input shows of a value; empty for none."""
    if value is None:
        return ""
    if isinstance(value, bool) or not isinstance(value, list | dict):
        return f"{value:.12g}" if isinstance(value, float) else str(value)
    text = yaml.safe_dump(value, default_flow_style=True, width=10**6, allow_unicode=True).strip()
    return text[1:-1] if isinstance(value, list) and node.sort == "list" else text


def placeholder(field: FormField) -> str:
    """The default, or what to give."""
    if field.default is not None and field.default != [] and field.default != {}:
        return input_text(field.node, field.default)
    return "to be given" if field.required else "not given"


def hint(field: FormField) -> str:
    """Help and limits in a line."""
    parts = [field.help.rstrip("."), field.node.bounds and f"{field.node.bounds} {field.unit}"]
    return " · ".join(part.strip() for part in parts if part)


def label(field: FormField) -> str:
    """Name and unit."""
    words = field.label.split()
    tail = {
        "mm", "um", "s", "ul", "ml", "min", "mmhg", "percent", "degrees", "deg", "mpa", "pa", "kpa",
        "gb", "dyn", "cm2", "mm2", "millimolar",
    }  # fmt: skip
    while field.unit and len(words) > 1 and words[-1] in tail:
        words.pop()
    name = " ".join(words)
    return f"{name} ({field.unit})" if field.unit else name


def _number(text: str) -> Any:
    try:
        return int(text)
    except ValueError:
        pass
    try:
        return float(text.replace("−", "-"))
    except ValueError:
        return text


def _value(text: str, sort: str) -> Any:
    bracketed = sort == "list" and not text.startswith("[")
    try:
        return read_yaml(f"[{text}]" if bracketed else text)
    except yaml.YAMLError:
        return text


# Input widget for one value of a recipe.

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


# Recipe form on the Design page: inputs for all fields in folding sections, errors beside them.

_LEAVES: Final = ("number", "text", "flag", "one_of", "profile", "file", "free")
_AXES: Final = ("x", "y", "z")


class FormPane:
    """Shows an editor's data as a form; rebuilt where the data's shape changes."""

    def __init__(self, editor: Editor) -> None:
        self._editor = editor
        self._inputs: dict[forms.Path, ValidationElement[Any]] = {}
        self._heads: dict[forms.Path, ui.expansion] = {}
        self._opened: set[forms.Path] = set()
        self._box = ui.column().classes("w-full gap-1")
        editor.changed.append(self._after)

    def build(self) -> None:
        """Make the whole form anew; what was open stays open."""
        self._inputs.clear()
        self._heads.clear()
        self._box.clear()
        with self._box:
            plain = [one for one in self._editor.form.fields if _is_leaf(one.node)]
            with ui.element("div").classes("pc-fields"):
                for field in plain:
                    self._leaf(field, (field.key,))
            for field in self._editor.form.fields:
                if field not in plain:
                    self._part(field, (field.key,))
        self._mark()

    def show(self, path: forms.Path) -> None:
        """Open the sections that lead to a field, and go there."""
        self._opened |= {path[:n] for n in range(1, len(path) + 1)}
        self.build()
        element = self._inputs.get(path) or self._heads.get(path)
        if element is not None:
            ui.run_javascript(
                f"setTimeout(() => {{ const e = getHtmlElement({element.id}); "
                "e.scrollIntoView({block: 'center'}); "
                "(e.querySelector('input, [tabindex]') || e).focus(); }, 300)"
            )

    def places(self) -> dict[str, forms.Path]:
        """Every field that the recipe as it is can have, by its words."""
        places: dict[str, forms.Path] = {}
        self._collect(self._editor.form, self._editor.data, (), places)
        return places

    def _collect(
        self, node: Node, value: Any, path: forms.Path, places: dict[str, forms.Path]
    ) -> None:
        if node.sort == "choice":
            option = node.option(value)
            node = option.node if option else Node("free")
        for field in node.fields:
            here = (*path, field.key)
            places[" › ".join([*map(str, path), label(field)])] = here
            self._collect(field.node, forms.value_at(value, (field.key,)), here, places)

    # --- parts ------------------------------------------------------------------------------

    def _part(self, field: FormField, path: forms.Path) -> None:
        """A field that holds others, to be opened."""
        if _is_leaf(field.node):
            self._leaf(field, path)
            return
        if field.node.sort == "row":
            self._row(field, path)
            return
        is_open = path in self._opened
        box = ui.expansion(field.label, value=is_open).classes("w-full pc-part")
        box.props("dense-toggle header-class=pc-part-head")
        self._heads[path] = box
        with box:
            inside = ui.column().classes("w-full gap-2")

        def opened() -> None:
            self._opened.discard(path)
            if box.value:
                self._opened.add(path)
                if not inside.default_slot.children:
                    with inside:
                        self._inside(field, path)
                    self._mark()

        box.on_value_change(opened)
        if is_open:
            with inside:
                self._inside(field, path)

    def _inside(self, field: FormField, path: forms.Path) -> None:
        node, value = field.node, forms.value_at(self._editor.data, path)
        if field.help:
            ui.label(field.help).classes("pc-quiet")
        if node.sort == "list":
            self._list(field, path, value)
        elif node.sort == "choice":
            self._choice(field, path, value)
        else:
            self._optional_section(field, path, value)

    def _optional_section(self, field: FormField, path: forms.Path, value: Any) -> None:
        if field.node.optional:
            self._switch(field, path, value is not None)
            if value is None:
                return
        self._fields(field.node, path)

    def _switch(self, field: FormField, path: forms.Path, on: bool) -> None:
        async def changed(event: Any) -> None:
            await self._say(path, {} if event.value else None, rebuild=True)

        ui.switch(f"with {field.label}", value=on, on_change=changed)

    def _choice(self, field: FormField, path: forms.Path, value: Any) -> None:
        options = {one.tag: one.tag.replace("_", " ") for one in field.node.options}
        if not field.required:
            options = {"": "default" if field.default else "none", **options}
        now = field.node.option(value)

        async def changed(event: Any) -> None:
            chosen = next((o for o in field.node.options if o.tag == event.value), None)
            begin = None if chosen is None else dict(chosen.begin)
            await self._say(path, begin, rebuild=True)

        tag = now.tag if now else ("" if not field.required else None)
        select = ui.select(options, label=f"kind of {field.label}", value=tag, on_change=changed)
        select.props("outlined dense stack-label").classes("pc-field")
        self._inputs[path] = select
        shown = now or field.node.option(field.default)
        if shown is not None:
            ui.label(shown.node.title).classes("pc-quiet")
            self._fields(shown.node, path, without=set(shown.begin) & _fixed(shown.node))

    def _fields(self, node: Node, path: forms.Path, without: set[str] | None = None) -> None:
        shown = [one for one in node.fields if one.key not in (without or set())]
        with ui.element("div").classes("pc-fields"):
            for field in shown:
                if _is_leaf(field.node):
                    self._leaf(field, (*path, field.key))
        for field in shown:
            if not _is_leaf(field.node):
                self._part(field, (*path, field.key))

    def _list(self, field: FormField, path: forms.Path, value: Any) -> None:
        item = replace(field, node=field.node.items[0], required=True, default=None, help="")
        count = len(value) if isinstance(value, list) else 0
        for number in range(count):
            here = (*path, number)
            with ui.card().classes("w-full").props("flat bordered"):
                with ui.row().classes("items-center w-full"):
                    ui.label(f"{field.label} {number + 1}").classes("pc-item")
                    ui.space()
                    ui.button("Remove", on_click=self._asking(here, None)).props("flat")
                if item.node.sort == "section":
                    self._fields(item.node, here)
                elif item.node.sort == "choice":
                    self._choice(item, here, value[number])
        begin: Any = dict(item.node.options[0].begin) if item.node.options else {}
        ui.button(f"Add to {field.label}", on_click=self._asking((*path, count), begin))

    def _asking(self, path: forms.Path, value: Any) -> Callable[[], Awaitable[None]]:
        async def ask() -> None:
            await self._say(path, value, rebuild=True)

        return ask

    def _row(self, field: FormField, path: forms.Path) -> None:
        """A few numbers beside each other, said together."""
        value = forms.value_at(self._editor.data, path)
        now: list[Any] = list(value) if isinstance(value, list) else []
        items = field.node.items
        default = field.default if isinstance(field.default, list) else [None] * len(items)
        names = _AXES if len(items) == 3 else ("", "") if len(items) != 2 else ("1st", "2nd")
        with ui.element("div").classes("pc-row").props(f'role=group aria-label="{field.label}"'):
            for k, node in enumerate(items):
                one = replace(
                    field, node=node, help=hint(field) if k == 0 else "", default=default[k]
                )
                number = now[k] if k < len(now) else None
                self._inputs[(*path, k)] = leaf(
                    one,
                    number,
                    self._saying_item(field, path, k),
                    self._editor.recipes,
                    f"{label(field)} {names[k]}",
                )

    def _saying_item(self, field: FormField, path: forms.Path, k: int) -> Say:
        async def say(value: Any) -> None:
            written = forms.value_at(self._editor.data, path)
            default = field.default if isinstance(field.default, list) else []
            begin = written if isinstance(written, list) else default
            count = len(field.node.items)
            row = [begin[i] if i < len(begin) else None for i in range(count)]
            row[k] = value
            empty = all(one is None for one in row)
            await self._say(path, None if empty or row == field.default else row)

        return say

    def _leaf(self, field: FormField, path: forms.Path) -> None:
        async def say(value: Any) -> None:
            same = value == field.default and not field.required
            await self._say(path, None if same and value is not True else value)

        value = forms.value_at(self._editor.data, path)
        self._inputs[path] = leaf(field, value, say, self._editor.recipes)

    # --- changes ----------------------------------------------------------------------------

    async def _say(self, path: forms.Path, value: Any, rebuild: bool = False) -> None:
        if value is None:
            await run_or_notify(self._editor.remove, path)
        else:
            await run_or_notify(self._editor.put, path, value)
        self._editor.tell(False)
        if rebuild:
            self._opened.add(path)
            self.build()

    def _after(self, rebuild: bool) -> None:
        if rebuild:
            self.build()
        else:
            self._mark()

    def _mark(self) -> None:
        """Put what is wrong to its field, and how much is to the sections."""
        for path, element in self._inputs.items():
            element.error = self._editor.problem_at(path) or None
        for path, head in self._heads.items():
            count = self._editor.problems_below(path)
            head.props(f'caption="{count} to mend"' if count else "caption=")


def _fixed(node: Node) -> set[str]:
    """Keys that have one value alone: the kind says it."""
    return {f.key for f in node.fields if f.node.sort == "one_of" and len(f.node.values) == 1}


def _is_leaf(node: Node) -> bool:
    """Whether one input holds it; a list of plain values is one, too."""
    return node.sort in _LEAVES or (node.sort == "list" and node.items[0].sort in _LEAVES)


# Pane of the Recipe tab on which inlets and outlets are picked on the tissue's surface.

_LARGEST_MM: Final = 1e6
_NONE: Final = "Places are picked for grown vessels: grow: tree, closed_loop or forest."


class PickPane:
    """Shows the tissue once it is opened; a click sets what is chosen beside it.

    Parameters
    ----------
    editor : Editor
    service : DesignService
    """

    def __init__(self, editor: Editor, service: DesignService) -> None:
        self._editor, self._service, self._shown = editor, service, ""
        self._targets: dict[str, PickTarget] = {}
        box = ui.expansion("Pick inlets on the tissue", on_value_change=self._opened)
        self._box = box.classes("w-full pc-part").props("dense-toggle header-class=pc-part-head")
        with box:
            with ui.row().classes("w-full items-center gap-2"):
                self._select = ui.select([], label="A click on the surface sets")
                self._select.props("outlined dense").classes("pc-recipe")
                ui.button("Show the tissue anew", on_click=self._show).props("flat")
            self._note = ui.label().classes("pc-message").props("role=status")
            self._frame = ui.column().classes("w-full pc-pick")
        ui.on("pc_pick", self._picked)

    def refresh(self) -> None:
        """Offer what the recipe as it is has places for."""
        self._targets = {one.name: one for one in pick_targets(self._editor.data)}
        names = list(self._targets)
        now = self._select.value
        self._select.set_options(names, value=now if now in names else next(iter(names), None))
        if self._shown and self._shown != self._editor.name:
            self._box.value = False
            self._frame.clear()
            self._shown, self._note.text = "", ""

    async def _opened(self) -> None:
        if self._box.value and self._shown != self._editor.name:
            await self._show()

    async def _show(self) -> None:
        name = self._shown = self._editor.name
        self._frame.clear()
        self._note.text = "The tissue is being made ..."
        try:
            await make_in_thread(self._service.tissue, name)
        except WebError as exc:
            self._note.text = str(exc)
            return
        self._note.text = "" if self._targets else _NONE
        with self._frame:
            embed(f"/api/v1/recipes/{name}/tissue", f"Tissue of {name}")

    async def _picked(self, event: events.GenericEventArguments) -> None:
        at, target = place_of(event.args), self._targets.get(str(self._select.value))
        if at is None or target is None:
            self._note.text = _NONE
            return
        value = target.value(self._editor.data, at)
        await run_or_notify(self._editor.put, target.path, value)
        self._editor.tell(True)
        where = ", ".join(f"{x:.3f}" for x in at)
        self._note.text = f"{target.name}: {where} mm"


def place_of(given: Any) -> list[float] | None:
    """Return three numbers that a frame sent, or None for anything else."""
    at = given.get("at") if isinstance(given, dict) else None
    if not isinstance(at, list) or len(at) != 3:
        return None
    if any(isinstance(x, bool) or not isinstance(x, int | float) for x in at):
        return None
    place = [float(x) for x in at]
    return place if all(math.isfinite(x) and abs(x) < _LARGEST_MM for x in place) else None
