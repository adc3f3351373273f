"""Embed scripts in an HTML page: inlined modules, import map, data, content security policy.

ES modules can't be loaded from files beside a page opened by ``file://``. Here every module is a
``data:`` URL under a bare name of the import map, so that they import each other as usual.
"""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, Final

from markupsafe import Markup

_HERE: Final = Path(__file__).parent
_STATIC: Final = _HERE / "static"
_VENDORED: Final = {"three": "three.module.min.js", "three/orbit": "OrbitControls.js"}
ENTRY: Final = 'import "report/main";'


Folders = tuple[tuple[str, Path], ...]
"""Names of a page's own modules and where they lie."""


@cache
def import_map(own: Folders = ()) -> str:
    """Import map of all modules of the report's page, and of further folders, as JSON."""
    vendored = {name: _HERE / "vendor" / file for name, file in _VENDORED.items()}
    return _as_map(vendored | _modules("report", _STATIC) | _own(own))


@cache
def module_map(
    shared: tuple[str, ...], name: str = "", folder: Path | None = None, more: Folders = ()
) -> str:
    """Import map of a page with few of the report's modules, as JSON.

    Parameters
    ----------
    shared : tuple of str
        Of the report's modules, each under ``report/``.
    name, folder : str, Path or None
        All modules of the page's own folder, each under ``name/``.
    more : tuple of (str, Path)
        Further ones.
    """
    own = more if folder is None else ((name, folder), *more)
    return _as_map({f"report/{one}": _STATIC / f"{one}.js" for one in shared} | _own(own))


def _own(folders: Folders) -> dict[str, Path]:
    return {name: path for one in folders for name, path in _modules(*one).items()}


def _modules(name: str, folder: Path) -> dict[str, Path]:
    return {f"{name}/{path.stem}": path for path in sorted(folder.glob("*.js"))}


def _as_map(files: Mapping[str, Path]) -> str:
    return as_script_json({"imports": {name: data_url(path) for name, path in files.items()}})


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
