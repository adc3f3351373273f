"""Embed scripts in an HTML page: inlined modules, import map, data, content security policy.

ES modules can't be loaded from files beside a page opened by ``file://``. Here every module is a
``data:`` URL under a bare name of the import map, so that they import each other as usual.
"""

from __future__ import annotations

import base64
import hashlib
import json
import re
from functools import cache
from pathlib import Path
from typing import Any, Final

from markupsafe import Markup

_HERE: Final = Path(__file__).parent
_VENDORED: Final = {"three": "three.module.min.js", "three/orbit": "OrbitControls.js"}
_FOLDERS: Final = {
    "viewer": "viewer",
    "report": "static",
    "gcode": "gcode/static",
    "play": "play/static",
    "overlay": "overlay/static",
}
"""Where modules lie, by the first part of their names."""
_IMPORT: Final = re.compile(r'(?:from|import) "([^"]+)"')
ENTRY: Final = 'import "report/main";'


@cache
def import_map(entry: str = ENTRY) -> str:
    """Import map of all modules that a page's entry script needs, as JSON."""
    found: dict[str, str] = {}
    left = _IMPORT.findall(entry)
    while left:
        name = left.pop()
        if name in found:
            continue
        path = _path(name)
        found[name] = data_url(path)
        if name not in _VENDORED:
            left += _IMPORT.findall(path.read_text(encoding="utf-8"))
    return as_script_json({"imports": dict(sorted(found.items()))})


def _path(name: str) -> Path:
    if name in _VENDORED:
        return _HERE / "vendor" / _VENDORED[name]
    folder, _, stem = name.partition("/")
    return _HERE / _FOLDERS[folder] / f"{stem}.js"


def data_url(path: Path) -> str:
    """A script file as a URL that holds it."""
    return "data:text/javascript;base64," + base64.b64encode(path.read_bytes()).decode("ascii")


def as_script_json(value: Any) -> Markup:
    """JSON that can stand inside a script element whatever strings it holds.

    ``<``, ``>`` and ``&`` occur in JSON only within strings, where an escape says the same; so
    neither ``</script>`` nor ``<!--`` can end or open anything.
    """
    text = json.dumps(value, allow_nan=False, ensure_ascii=True, separators=(",", ":"))
    for sign in "<>&":
        text = text.replace(sign, f"\\u{ord(sign):04x}")
    return Markup(text)


def content_policy(inline_scripts: list[str]) -> str:
    """Content-Security-Policy under which nothing is fetched and no other script runs.

    Parameters
    ----------
    inline_scripts : list of str
        Text of each script element; named by hash, so that an injected one stays dead.
    """
    hashes = " ".join(f"'sha256-{script_hash(text)}'" for text in inline_scripts)
    return (
        f"default-src 'none'; script-src {hashes} data:; style-src 'unsafe-inline'; "
        "img-src data:; base-uri 'none'; form-action 'none'"
    )


def script_hash(text: str) -> str:
    """SHA-256 of a script's text in base64."""
    return base64.b64encode(hashlib.sha256(text.encode()).digest()).decode("ascii")
