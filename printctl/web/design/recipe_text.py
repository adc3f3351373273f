"""Parse and change a recipe's YAML text in place, so that comments stay."""

from __future__ import annotations

from typing import Any, Final

import yaml

from firmware_profiles.yaml_file import read_yaml
from printctl.recipe.schema import KeyPath
from printctl.web.errors import BadRequestError

# ruamel.yaml drops the comments behind a key that is removed: 7 of the starter recipe's 62.

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


def rewrite_yaml(text: str, new: dict[str, Any]) -> str:
    """The text with the data ``new``; what hasn't changed stays as it is, comments with it.

    Where that can't be done the whole is written anew, without comments.
    """
    try:
        draft = _spliced(text, new)
        if draft is not None and read_yaml(draft) == new:
            return draft
    except (yaml.YAMLError, ValueError):
        pass
    return dumped(new)


def dumped(data: Any) -> str:
    """Data as a recipe's text: sections in lines, short lists in one."""
    return yaml.dump(data, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=100, indent=2)


class _Dumper(yaml.SafeDumper):
    """Lists of plain values in one line, all else in lines of their own."""


def _list(dumper: yaml.SafeDumper, value: list[Any]) -> yaml.Node:
    plain = not any(isinstance(one, dict | list) for one in value)
    return dumper.represent_sequence("tag:yaml.org,2002:seq", value, flow_style=plain)


_Dumper.add_representer(list, _list)
_Dumper.ignore_aliases = lambda self, data: True  # type: ignore[method-assign]


def _spliced(text: str, new: dict[str, Any]) -> str | None:
    for _ in range(200):
        old = read_yaml(text)
        if old == new:
            return text
        root = yaml.compose(text, Loader=yaml.SafeLoader)
        changed = _change(text, root, old, new) if isinstance(root, yaml.MappingNode) else None
        if changed is None:
            return None
        text = changed
    return None


def _change(text: str, node: yaml.MappingNode, old: Any, new: Any) -> str | None:
    """The text with one difference mended."""
    if node.flow_style or not node.value:
        return None
    pairs = {key.value: (key, value) for key, value in node.value}
    for name, (key, value) in pairs.items():
        if name not in new:
            first, after = key.start_mark.line, _last_line(value) + 1
            return _with_lines(text, first, after, "") if len(pairs) > 1 else None
        if old[name] == new[name] and isinstance(old[name], bool) == isinstance(new[name], bool):
            continue
        both = isinstance(old[name], dict) and isinstance(new[name], dict) and new[name]
        if both and isinstance(value, yaml.MappingNode) and not _in_line(value):
            return _change(text, value, old[name], new[name])
        return _replaced(text, key, value, new[name])
    added = next((name for name in new if name not in old), None)
    if added is None:
        return None
    key, value = node.value[-1]
    entry = _lines(added, new[added], key.start_mark.column)
    return _with_lines(text, _last_line(value) + 1, _last_line(value) + 1, entry)


def _replaced(text: str, key: yaml.Node, value: yaml.Node, new: Any) -> str:
    inner = new if isinstance(new, list) else ()
    plain = not isinstance(new, dict) and not any(isinstance(one, dict | list) for one in inner)
    if _in_line(value) or (plain and isinstance(value, yaml.ScalarNode)):
        shown = yaml.safe_dump(
            new, default_flow_style=True, allow_unicode=True, width=10**6, sort_keys=False
        )
        shown = shown.removesuffix("\n").removesuffix("\n...")
        return text[: value.start_mark.index] + shown + text[value.end_mark.index :]
    entry = _lines(str(key.value), new, key.start_mark.column)
    return _with_lines(text, key.start_mark.line, _last_line(value) + 1, entry)


def _in_line(node: yaml.Node) -> bool:
    """Whether a list or mapping is written with brackets."""
    return bool(getattr(node, "flow_style", False))


def _lines(key: str, value: Any, column: int) -> str:
    pad = " " * column
    return "".join(f"{pad}{line}\n" for line in dumped({key: value}).splitlines())


def _last_line(node: yaml.Node) -> int:
    """The line of a node's last sign; a block's own end mark lies behind its comments."""
    if isinstance(node, yaml.ScalarNode) or _in_line(node) or not node.value:
        return int(node.end_mark.line)
    last = node.value[-1]
    return _last_line(last[1] if isinstance(last, tuple) else last)


def _with_lines(text: str, first: int, after: int, entry: str) -> str:
    lines = text.splitlines(keepends=True)
    if lines and not lines[-1].endswith("\n"):
        lines[-1] += "\n"
    return "".join([*lines[:first], entry, *lines[after:]])


def changed(data: dict[str, Any], path: KeyPath, value: Any) -> dict[str, Any]:
    """Return the data with a value at a path, or without one there for None.

    Sections and lists on the way come into being; an index behind a list's end adds to it.

    Raises
    ------
    BadRequestError
        For a path that leads nowhere.
    """
    new: dict[str, Any] = _with_value(data, path, value, path)
    return new


def _with_value(inside: Any, path: KeyPath, value: Any, whole: KeyPath) -> Any:
    key, *rest = path
    kind = list if isinstance(key, int) else dict
    if not isinstance(inside, kind) or (isinstance(key, int) and not 0 <= key <= len(inside)):
        raise BadRequestError(f"{'.'.join(map(str, whole))[:200]}: there is no such place")
    items: dict[Any, Any] = dict(enumerate(inside)) if kind is list else dict(inside)
    if rest:
        below, following = items.get(key), list if isinstance(rest[0], int) else dict
        if isinstance(below, following) or value is not None:
            below = below if isinstance(below, following) else following()
            items[key] = _with_value(below, tuple(rest), value, whole)
    elif value is None:
        items.pop(key, None)
    else:
        items[key] = value
    return list(items.values()) if kind is list else items
