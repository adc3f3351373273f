"""Read YAML text, refusing duplicate keys and numbers with colons (base 60)."""

from __future__ import annotations

import re
from collections.abc import Hashable
from typing import Any, Final

import yaml

_MERGE: Final = "tag:yaml.org,2002:merge"
_NUMBERS: Final = ("tag:yaml.org,2002:int", "tag:yaml.org,2002:float")


class RepeatedKey(yaml.YAMLError):
    """A key that stands twice in one mapping; plain YAML readers silently take the last."""


class MinutesNumber(yaml.YAMLError):
    """Digits with colons, like 1:30, which YAML 1.1 reads as minutes and seconds."""


class _OnceLoader(yaml.SafeLoader):
    """PyYAML's safe loader, with keys that stand twice and numbers to base 60 refused."""

    def construct_scalar(self, node: yaml.ScalarNode | yaml.MappingNode) -> Any:
        if isinstance(node.value, str) and node.tag in _NUMBERS and ":" in node.value:
            raise MinutesNumber(
                f"{node.value} in line {node.start_mark.line + 1} would be read as minutes and "
                f"seconds; write a plain number, or text in quotes: '{node.value}'"
            )
        return super().construct_scalar(node)

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        lines: dict[Hashable, int] = {}
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode) or key.tag == _MERGE:
                continue
            name, line = self.construct_object(key), key.start_mark.line + 1
            if name in lines:
                raise RepeatedKey(
                    f"key {name!r} stands twice, in line {lines[name]} and in line {line}; keep one"
                )
            lines[name] = line
        return super().construct_mapping(node, deep)


# YAML 1.2 takes 1e-3 as a number, PyYAML (1.1) as text.
_OnceLoader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"[-+]?(?:[0-9][0-9_]*\.?[0-9_]*|\.[0-9]+)[eE][-+]?[0-9]+$"),
    list("-+.0123456789"),
)


def read_yaml(text: str) -> Any:
    """Return the data of a YAML text.

    Raises
    ------
    yaml.YAMLError
        When it isn't YAML; `RepeatedKey`, with both lines, when a key stands twice;
        `MinutesNumber`.
    """
    return yaml.load(text, Loader=_OnceLoader)
