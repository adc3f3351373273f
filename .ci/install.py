"""Install pinned packages by uv, or by pip where uv can't: `python .ci/install.py PYTHON WHAT...`.

uv takes a sixth of pip's time. It asks the index, folder of wheels and certificate that pip is set
to. What it can't find or do is left to pip, which says why.
"""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path

PINS = str(Path(__file__).resolve().parents[1] / "constraints.txt")
PIP = ("-m", "pip", "--quiet", "--disable-pip-version-check")
NAMES = {"index-url": "UV_DEFAULT_INDEX", "find-links": "UV_FIND_LINKS", "cert": "SSL_CERT_FILE"}


def settings(listed: str) -> dict[str, str]:
    """Return uv's environment variables for what `pip config list` says."""
    found = {}
    for line in listed.splitlines():
        key, _, value = line.partition("=")
        name = NAMES.get(key.rpartition(".")[2])
        if name and name not in os.environ:
            # Several folders stand on lines or between blanks; uv wants commas.
            found[name] = ",".join(str(ast.literal_eval(value)).split())
    return found


def by_uv(python: str, what: list[str]) -> bool:
    """Try it with uv; return whether that went well."""
    here = sys.executable
    uv = [*PIP, "install", "--no-compile", "--constraint", PINS, "uv"]
    if subprocess.run([here, *uv], capture_output=True, check=False).returncode:
        return False
    listed = subprocess.run([here, *PIP, "config", "list"], capture_output=True, text=True)
    command = [here, "-m", "uv", "pip", "install", "--quiet", "--python", python]
    done = subprocess.run(
        [*command, "--constraint", PINS, *what],
        env=os.environ | settings(listed.stdout),
        capture_output=True,
        check=False,
    )
    return done.returncode == 0


def main(python: str, *what: str) -> int:
    """Install into the environment of another interpreter."""
    if by_uv(python, list(what)):
        return 0
    print("uv can't install it; now by pip", flush=True)
    command = [python, *PIP, "install", "--no-compile", "--constraint", PINS, *what]
    return subprocess.run(command, check=False).returncode


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
