"""Dependency audit: fails on vulnerabilities, reports when it couldn't ask."""

import ast
import importlib.util
import re
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from firmware_profiles.families import family_names

PLACE = Path(__file__).parents[1] / ".ci" / "audit.py"


@pytest.fixture
def audit(monkeypatch):
    spec = importlib.util.spec_from_file_location("audit", PLACE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "audit", module)
    spec.loader.exec_module(module)
    return module


SAFE = {"name": "numpy", "version": "2.4.6", "vulns": []}
BAD = {
    "name": "pillow",
    "version": "1.0",
    "vulns": [{"id": "CVE-2020-1", "fix_versions": ["1.1"], "description": "x"}],
}
UNKNOWN = {"name": "ours", "skip_reason": "Dependency not found on PyPI"}


def answers(audit, monkeypatch, *dependencies):
    monkeypatch.setattr(audit, "ask", lambda service: audit.read({"dependencies": dependencies}))


def test_a_known_vulnerability_fails_with_name_and_remedy(audit, monkeypatch, capsys):
    answers(audit, monkeypatch, SAFE, BAD, UNKNOWN)
    assert audit.main() == 1
    out = capsys.readouterr().out
    assert "pillow 1.0: CVE-2020-1 (fixed in 1.1)" in out
    assert "2 pins asked of pypi, 1 unknown to it: 1 vulnerable" in out


def test_nothing_known_passes(audit, monkeypatch, capsys):
    answers(audit, monkeypatch, SAFE)
    assert audit.main() == 0
    assert "0 vulnerable" in capsys.readouterr().out


def test_a_service_that_knows_no_pin_was_not_asked(audit, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["audit.py"])
    answers(audit, monkeypatch, UNKNOWN)
    assert audit.main() == 2
    assert "NOT DONE" in capsys.readouterr().out


@pytest.mark.parametrize(("given", "code"), [([], 2), (["--if-reachable"], 0)])
def test_an_audit_that_no_service_answered_fails_unless_that_is_allowed(
    audit, monkeypatch, capsys, given, code
):
    monkeypatch.setattr(audit, "ask", lambda service: None)
    monkeypatch.setattr(sys, "argv", ["audit.py", *given])
    assert audit.main() == code
    assert "NOT DONE" in capsys.readouterr().out


# Installing by uv: pip's settings handed on.

PLACE_INSTALL = Path(__file__).parents[1] / ".ci" / "install.py"


@pytest.fixture
def install(monkeypatch):
    spec = importlib.util.spec_from_file_location("install", PLACE_INSTALL)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    for name in module.NAMES.values():
        monkeypatch.delenv(name, raising=False)
    return module


def test_uv_asks_where_pip_is_told_to_ask(install):
    listed = "global.index-url='here/simple'\n:env:.find-links='/one\\n/two'\nuser.timeout='9'\n"
    assert install.settings(listed) == {
        "UV_DEFAULT_INDEX": "here/simple",
        "UV_FIND_LINKS": "/one,/two",
    }


def test_what_uv_was_told_itself_stays(install, monkeypatch):
    monkeypatch.setenv("SSL_CERT_FILE", "mine.pem")
    assert install.settings("global.cert='pips.pem'\n") == {}


def test_what_uv_cannot_install_is_left_to_pip(install, monkeypatch, capsys):
    asked = []
    monkeypatch.setattr(install, "by_uv", lambda python, what: False)

    def run(command, check):
        asked.append(command)
        return type("Done", (), {"returncode": 3})

    monkeypatch.setattr(install.subprocess, "run", run)
    assert install.main("there/python", "printctl.whl") == 3
    assert [(words[0], words[-1]) for words in asked] == [("there/python", "printctl.whl")]
    assert "now by pip" in capsys.readouterr().out


# Contents of the installed wheel.

ROOT = Path(__file__).resolve().parents[1]
OURS = {"design", "firmware_profiles", "kernels", "printctl", "registration", "sim"}


@pytest.mark.slow
def test_wheel_has_our_packages_and_their_data_and_nothing_else(tmp_path: Path) -> None:
    # From a copy: setuptools leaves its build folder behind.
    source = tmp_path / "source"
    for package in OURS:
        shutil.copytree(ROOT / package, source / package)
    shutil.copytree(ROOT / "examples", source / "examples")
    for name in ("pyproject.toml", "setup.py", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source / name)
    command = [sys.executable, "-m", "pip", "wheel", "--no-deps", "--quiet", "-w", str(tmp_path)]
    done = subprocess.run([*command, str(source)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    (wheel,) = tmp_path.glob("*.whl")
    names = zipfile.ZipFile(wheel).namelist()
    top = {name.split("/")[0] for name in names}
    assert {name for name in top if not name.endswith(".dist-info")} == OURS
    for needed in (
        "firmware_profiles/data/printers/generic_marlin.yaml",
        "printctl/recipe/starter.yaml",
        "printctl/examples/planar_tree.yaml",
        "printctl/py.typed",
    ):
        assert needed in names
    assert any(name.startswith("report/vendor/") for name in names)
    assert any(name.startswith("report/templates/") for name in names)


# --- firmware family names occur only in their own packages
HOME = Path(__file__).parents[1]
PACKAGES = ("firmware_profiles", "design", "sim", "registration", "printctl", "docs_tools")
HOMES = ("firmware_profiles.families", "sim.devices.families")
NAME = re.compile(rf"\b({'|'.join(family_names())})\b")
WORD = re.compile(rf"firmware|{'|'.join(family_names())}")
SEAM = re.compile(r"""["']\s*[a-zA-Z]?["']|\\""")
"""What may stand within a word in a source: two strings beside each other, a backslash."""
INSIDE = re.compile(rf"({'|'.join(HOMES)})\.({'|'.join(family_names())})(_|\b)")


def sources() -> Iterator[Path]:
    for package in PACKAGES:
        for path in sorted((HOME / package).rglob("*.py")):
            if not any(home.replace(".", "/") in path.as_posix() for home in HOMES):
                yield path


def faults(text: str) -> list[str]:
    """Where a source names a family, or asks a profile which firmware it has."""
    if not WORD.search(SEAM.sub("", text)):
        return []
    tree = ast.parse(text)
    found = []
    prose = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        line = getattr(node, "lineno", 0)
        if isinstance(node, ast.Constant) and id(node) not in prose:
            value = node.value.decode("latin-1") if isinstance(node.value, bytes) else node.value
            if isinstance(value, str) and NAME.search(value):
                found.append(f"line {line} names a family: {value[:60]!r}")
        if any(is_firmware(one) for one in asked(node)):
            found.append(f"line {line} asks which firmware it is: {ast.unparse(node)[:80]}")
        found += [f"line {line} reaches into a home: {name}" for name in reached(node)]
    return found


def asked(node: ast.AST) -> list[ast.expr]:
    """What a node compares, or looks up in a table."""
    if isinstance(node, ast.Compare):
        return [node.left, *node.comparators]
    if isinstance(node, ast.Subscript):
        return [node.slice]
    if isinstance(node, ast.Match):
        return [node.subject]
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
        table = node.func.attr in ("get", "startswith", "endswith")
        return [*node.args, node.func.value] if table else []
    return []


def is_firmware(node: ast.expr) -> bool:
    return isinstance(node, ast.Attribute) and node.attr == "firmware"


def reached(node: ast.AST) -> list[str]:
    """Modules of one family that a node imports."""
    if isinstance(node, ast.ImportFrom):
        names = [f"{node.module}.{alias.name}" for alias in node.names]
    else:
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
    return [name for name in names if INSIDE.match(name)]


def test_no_family_is_named_outside_its_home() -> None:
    found = {}
    for path in sources():
        name = path.relative_to(HOME).as_posix()
        text = path.read_text(encoding="utf-8")
        told = faults(text) if NAME.search(text) or "firmware" in text else []
        if told:
            found[name] = told
    assert not found


@pytest.mark.parametrize(
    "text",
    [
        'if printer.firmware == "x":\n    pass',
        "if printer.firmware in OWN:\n    pass",
        "TABLE[printer.firmware]",
        "found = TABLE.get(printer.firmware, ())",
        "match printer.firmware:\n    case _:\n        pass",
        'FAMILIES = {"klipper": 1}',
        'found = f"say marlin {x}"',
        "from firmware_profiles.families.klipper import FAMILY",
        "from firmware_profiles.families import klipper",
        "import sim.devices.families.marlin_printer",
    ],
)
def test_what_names_a_family_is_found(text: str) -> None:
    assert faults(text)


def test_words_in_a_docstring_and_in_a_sentence_are_none() -> None:
    assert not faults('"""As marlin does."""\nraise ValueError("Marlin reads another number")')


TOP_LEVEL = """
.gitignore CHANGELOG.md CONTRIBUTING.md LICENSE MANIFEST.in Makefile README.md SECURITY.md
constraints.txt mkdocs.yml pyproject.toml setup.py
"""


def test_no_stray_file_was_committed_at_the_top() -> None:
    """Commands that are tried in the project folder write their files there."""
    git = ["git", "-C", str(PLACE.parents[1]), "ls-files"]
    listed = subprocess.run(git, capture_output=True, text=True, check=False)
    if listed.returncode:
        pytest.skip("not a git checkout")
    names = [name for name in listed.stdout.split("\n") if name and "/" not in name]
    assert names == TOP_LEVEL.split()
