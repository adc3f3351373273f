"""Read YAML text, refusing duplicate keys."""

from __future__ import annotations

from collections.abc import Hashable
from typing import Any, Final

import yaml

_MERGE: Final = "tag:yaml.org,2002:merge"


class RepeatedKey(yaml.YAMLError):
    """A key that stands twice in one mapping; plain YAML readers silently take the last."""


class _OnceLoader(yaml.SafeLoader):
    """PyYAML's safe loader, with the keys of each mapping checked."""

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


def read_yaml(text: str) -> Any:
    """Return the data of a YAML text.

    Raises
    ------
    yaml.YAMLError
        When it isn't YAML; `RepeatedKey`, with both lines, when a key stands twice.
    """
    return yaml.load(text, Loader=_OnceLoader)
