"""FAQ page: one entry per user-visible error class, and no other."""

import re
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = ("firmware_profiles", "design", "sim", "registration", "printctl")
QUESTIONS = "## Questions that aren't errors"


CLASS = re.compile(r"^ *class (\w+)(?:\[[^:]*\])?\(([^)]*)\):", re.MULTILINE)


@cache
def error_classes() -> set[str]:
    """Public exception classes by source: no module with an extra has to be imported."""
    bases = {}
    for package in PACKAGES:
        for path in (ROOT / package).rglob("*.py"):
            for name, listed in CLASS.findall(path.read_text(encoding="utf-8")):
                bases[name] = {base.strip().split(".")[-1] for base in listed.split(",")}
    known = {"Exception", "ValueError", "RuntimeError", "OSError", "KeyError", "TypeError"}
    while grown := {name for name, of in bases.items() if of & known} - known:
        known |= grown
    # What carries no message for people (a stop that was asked for) is no error.
    return {name for name in known & set(bases) if not name.startswith("_")} - {"PrintEnded"}


def entries() -> set[str]:
    errors, _ = (ROOT / "docs" / "faq.md").read_text(encoding="utf-8").split(QUESTIONS)
    return {line.removeprefix("### ") for line in errors.splitlines() if line.startswith("### ")}


def test_every_public_error_is_in_the_faq():
    assert error_classes() - entries() == set()


def test_the_faq_has_no_error_that_is_gone():
    assert entries() - error_classes() == set()
