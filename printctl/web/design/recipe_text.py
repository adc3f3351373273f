"""Parse and change a recipe's YAML text in place, so that comments stay."""

from __future__ import annotations

import contextlib
import textwrap
from collections.abc import Iterator, Mapping
from typing import Any, Final

import yaml

from firmware_profiles.yaml_file import read_yaml
from printctl.recipe.schema import KeyPath
from printctl.web.errors import BadRequestError

MOST_BYTES: Final = 256_000
MOST_DEPTH: Final = 30


def read_text(text: str) -> dict[str, Any]:
    """Keys and values of a recipe's text.

    Raises
    ------
    BadRequestError
        When it isn't YAML, is too large or too deep, holds no keys, or uses aliases or tags, which
        a recipe never needs and a trap may.
    """
    try:
        size = len(text.encode())
    except UnicodeEncodeError as exc:
        raise BadRequestError("a recipe is text in UTF-8; this holds signs that aren't") from exc
    if size > MOST_BYTES:
        raise BadRequestError(f"a recipe is at most {MOST_BYTES // 1000} kB; this has more")
    try:
        _check_events(text)
        data = read_yaml(text)
    except yaml.MarkedYAMLError as exc:
        mark = exc.problem_mark
        where = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
        raise BadRequestError(f"this isn't YAML: {where}{exc.problem}") from exc
    except (yaml.YAMLError, ValueError, RecursionError) as exc:
        raise BadRequestError(f"this isn't YAML: {exc}") from exc
    if not isinstance(data, dict) or any(not isinstance(key, str) for key in data):
        raise BadRequestError("this holds no keys; begin with `schema: 1` and `name: ...`")
    return data


def read_value(text: str) -> Any:
    """Return a value written as YAML; text that isn't YAML as it is, which a check then refuses.

    Raises
    ------
    BadRequestError
        As `read_text`, for aliases, tags and too many levels.
    """
    try:
        _check_events(text)
        return read_yaml(text)
    except (yaml.YAMLError, ValueError, RecursionError):
        return text


def _check_events(text: str) -> None:
    depth = 0
    for event in yaml.parse(text, Loader=yaml.SafeLoader):
        line = event.start_mark.line + 1 if event.start_mark else 0
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None):
            raise BadRequestError(f"line {line}: aliases (& and *) aren't taken; write it out")
        if getattr(event, "tag", None):
            raise BadRequestError(f"line {line}: tags (!) aren't taken; write the plain value")
        depth += isinstance(event, yaml.CollectionStartEvent)
        depth -= isinstance(event, yaml.CollectionEndEvent)
        if depth > MOST_DEPTH:
            raise BadRequestError(f"line {line}: more than {MOST_DEPTH} levels deep; no recipe is")


def with_values(text: str, values: Mapping[KeyPath, Any]) -> str:
    """Return a recipe's text with values at paths, as `changed` puts them; its comments stay.

    Raises
    ------
    BadRequestError
        When it can't be read, or a path leads nowhere.
    """
    data = read_text(text)
    for path, value in values.items():
        data = changed(data, path, value)
    return rewrite_yaml(text, data)


def rewrite_yaml(text: str, new: dict[str, Any]) -> str:
    """The text with the data ``new``; what hasn't changed stays as it is, comments with it.

    Where that can't be done the whole is written anew, without comments.
    """
    draft: str | None = text
    with contextlib.suppress(yaml.YAMLError, ValueError):
        for _ in range(200):
            if draft is None:
                break
            old = read_yaml(draft)
            if old == new:
                return draft
            draft = _change(draft, yaml.compose(draft, Loader=yaml.SafeLoader), old, new)
    return _dumped(new)


def _dumped(data: Any) -> str:
    """Data as a recipe's text: sections in lines, short lists in one."""
    return yaml.dump(data, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=100, indent=2)


class _Dumper(yaml.SafeDumper):
    """Lists of plain values in one line, all else in lines of their own."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


def _list(dumper: yaml.SafeDumper, value: list[Any]) -> yaml.Node:
    return dumper.represent_sequence("tag:yaml.org,2002:seq", value, flow_style=_is_plain(value))


_Dumper.add_representer(list, _list)


def _is_plain(value: Any) -> bool:
    """Whether a value is no section, and a list of none."""
    inner = value if isinstance(value, list) else [value]
    return not any(isinstance(one, dict | list) for one in inner)


def _change(text: str, node: yaml.Node | None, old: Any, new: Any) -> str | None:
    """The text with one difference mended; None where that can't be done."""
    if not isinstance(node, yaml.MappingNode) or node.flow_style or not node.value:
        return None
    for key, value in node.value:
        name = key.value
        if name not in new:
            one = len(node.value) > 1
            return _with_lines(text, key.start_mark.line, _next_line(value), "") if one else None
        if old[name] == new[name] and isinstance(old[name], bool) == isinstance(new[name], bool):
            continue
        both = isinstance(old[name], dict) and isinstance(new[name], dict) and new[name]
        if both and isinstance(value, yaml.MappingNode) and not _in_line(value):
            return _change(text, value, old[name], new[name])
        return _replaced(text, key, value, new[name])
    added = next((name for name in new if name not in old), None)
    if added is None:
        return None
    end = _next_line(node)
    return _with_lines(text, end, end, _lines(added, new[added], node.value[-1][0]))


def _replaced(text: str, key: yaml.Node, value: yaml.Node, new: Any) -> str:
    if _in_line(value) or (_is_plain(new) and isinstance(value, yaml.ScalarNode)):
        shown = yaml.safe_dump(
            new, default_flow_style=True, allow_unicode=True, width=10**6, sort_keys=False
        )
        shown = shown.removesuffix("\n").removesuffix("\n...")
        return text[: value.start_mark.index] + shown + text[value.end_mark.index :]
    return _with_lines(text, key.start_mark.line, _next_line(value), _lines(key.value, new, key))


def _in_line(node: yaml.Node) -> bool:
    """Whether a list or mapping is written with brackets."""
    return bool(getattr(node, "flow_style", False))


def _lines(name: str, value: Any, like: yaml.Node) -> str:
    """An entry of a section, as far to the right as another key of it."""
    return textwrap.indent(_dumped({name: value}), " " * like.start_mark.column)


def _next_line(node: yaml.Node) -> int:
    """The line after a node's last sign; a block's own end mark lies behind its comments."""
    if isinstance(node, yaml.ScalarNode) or _in_line(node) or not node.value:
        return int(node.end_mark.line) + 1
    last = node.value[-1]
    return _next_line(last[1] if isinstance(last, tuple) else last)


def _with_lines(text: str, first: int, after: int, entry: str) -> str:
    lines = text.splitlines(keepends=True)
    if lines and not lines[-1].endswith("\n"):
        lines[-1] += "\n"
    return "".join([*lines[:first], entry, *lines[after:]])


def changed(data: Any, path: KeyPath, value: Any, whole: KeyPath = ()) -> Any:
    """Return the data with a value at a path, or without one there for None.

    Sections and lists on the way come into being; an index behind a list's end adds to it.

    Raises
    ------
    BadRequestError
        For a path that leads nowhere; it names the ``whole`` of which ``path`` is the rest.
    """
    key, *rest = path
    whole = whole or path
    kind = list if isinstance(key, int) else dict
    if not isinstance(data, kind) or (isinstance(key, int) and not 0 <= key <= len(data)):
        raise BadRequestError(f"{'.'.join(map(str, whole))[:200]}: there is no such place")
    items: dict[Any, Any] = dict(enumerate(data)) if kind is list else dict(data)
    if rest:
        below, following = items.get(key), list if isinstance(rest[0], int) else dict
        if isinstance(below, following) or value is not None:
            below = below if isinstance(below, following) else following()
            items[key] = changed(below, tuple(rest), value, whole)
    elif value is None:
        items.pop(key, None)
    else:
        items[key] = value
    return list(items.values()) if kind is list else items


_MOST_DIFFERENCES: Final = 5


def differences(theirs: str, yours: str) -> str:
    """Say which values of two texts differ, and what each of them has; the first few."""
    there, here = (dict(_leaves(read_text(text))) for text in (theirs, yours))
    keys = [key for key in {**there, **here} if there.get(key) != here.get(key)]
    said = [
        f"{'.'.join(map(str, key))} is {_shown(there, key)} there and {_shown(here, key)} here"
        for key in keys[:_MOST_DIFFERENCES]
    ]
    if len(keys) > _MOST_DIFFERENCES:
        said.append(f"{len(keys) - _MOST_DIFFERENCES} more differ")
    return "; ".join(said) or "only comments differ"


def _leaves(data: Any, path: KeyPath = ()) -> Iterator[tuple[KeyPath, Any]]:
    if isinstance(data, dict) and data:
        for key, value in data.items():
            yield from _leaves(value, (*path, key))
    else:
        yield path, data


def _shown(leaves: Mapping[KeyPath, Any], key: KeyPath) -> str:
    return str(leaves[key])[:60] if key in leaves else "missing"
