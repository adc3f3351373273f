"""Kernel cache key: changes with everything that the machine code depends on, nothing else."""

import enum
import importlib
import random
import sys
from collections import namedtuple
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
import pytest
from numba import typeof
from numba.core.dispatcher import Dispatcher
from numba.typed import Dict, List

from kernels import jit
from kernels.key import kernel_key, signature_text
from tests.kernels.all_kernels import all_kernels, kernel_name, names_read

COMMON = "from kernels import jit, pjit\nfrom typing import NamedTuple\nimport numpy as np\n"
OTHER = f"{COMMON}FACTOR = 2.0\nLIMITS = (1, 2)\nTABLE = np.array([1.0, 2.0])\nKIND = np.float64\n"
SOURCE = f"""{COMMON}
import kernel_other as other
from kernel_other import FACTOR, LIMITS, TABLE, KIND

class Law(NamedTuple):
    slope: float
    offset: float

class Unread(NamedTuple):
    left: float

@jit
def inner(x):
    return x * FACTOR + LIMITS[0] + TABLE[1]

@jit
def outer(x):
    \"\"\"Old text.\"\"\"
    law = Law(x, 1.0)
    return inner(law.slope) + np.zeros(2, KIND)[0]

@jit
def by_module(x):
    return x * other.FACTOR

@jit
def alone(x):
    return x + 1.0
"""


def _load(folder: Path, source: str, other: str) -> ModuleType:
    (folder / "kernel_other.py").write_text(other)
    (folder / "kernel_source.py").write_text(source)
    for name in ("kernel_other", "kernel_source"):
        sys.modules.pop(name, None)
    importlib.invalidate_caches()
    return importlib.import_module("kernel_source")


def _keys(folder: Path, source: str = SOURCE, other: str = OTHER) -> dict[str, str]:
    module = _load(folder, source, other)
    names = ("inner", "outer", "by_module", "alone")
    return {name: kernel_key(getattr(module, name), {}) for name in names}


@pytest.mark.parametrize(
    ("old", "new", "changed"),
    [
        pytest.param("x + 1.0", "x + 2.0", {"alone"}, id="constant in the body"),
        pytest.param("return x * FACTOR", "return x / FACTOR", {"inner", "outer"}, id="callee"),
        pytest.param(
            "FACTOR = 2.0", "FACTOR = 3.0", {"inner", "outer", "by_module"}, id="constant"
        ),
        pytest.param("LIMITS = (1, 2)", "LIMITS = (1, 3)", {"inner", "outer"}, id="tuple"),
        pytest.param("LIMITS = (1, 2)", "LIMITS = (1.0, 2)", {"inner", "outer"}, id="number"),
        pytest.param("[1.0, 2.0]", "[1.0, 2.5]", {"inner", "outer"}, id="array"),
        pytest.param("[1.0, 2.0]", "[1, 2]", {"inner", "outer"}, id="array's dtype"),
        pytest.param("KIND = np.float64", "KIND = np.float32", {"outer"}, id="dtype"),
        pytest.param(
            "slope: float\n    offset: float",
            "offset: float\n    slope: float",
            {"outer"},
            id="fields",
        ),
        pytest.param("@jit\ndef alone", "@pjit\ndef alone", {"alone"}, id="flags"),
        pytest.param("def alone(x)", "def alone(x=1.0)", {"alone"}, id="default"),
        pytest.param("Old text.", "New text,\n    longer.", set(), id="docstring"),
        pytest.param("@jit\ndef alone", "# Why.\n\n\n@jit\ndef alone", set(), id="lines above"),
        pytest.param("left: float", "left: int", set(), id="unread class"),
    ],
)
def test_key_changes_for_the_kernels_that_take_the_change_in(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, old: str, new: str, changed: set[str]
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    assert old in SOURCE + OTHER
    before = _keys(tmp_path)
    after = _keys(tmp_path, SOURCE.replace(old, new), OTHER.replace(old, new))
    assert {name for name in before if before[name] != after[name]} == changed


class LawsA:
    """Holds a class of one field order."""

    class Law(NamedTuple):
        """Slope first."""

        slope: float
        offset: float


class LawsB:
    """Holds a class of the other field order."""

    class Law(NamedTuple):
        """Offset first."""

        offset: float
        slope: float


LawsB.Law.__qualname__ = LawsA.Law.__qualname__


def test_argument_types_tell_field_order_and_enum_values() -> None:
    orders = [("slope", "offset"), ("offset", "slope")]
    laws = [namedtuple("Law", order) for order in orders]  # type: ignore[misc]
    kinds = [enum.IntEnum("Kind", values) for values in ({"A": 1}, {"A": 2})]
    for first, second in (
        (laws[0](1.0, 2.0), laws[1](1.0, 2.0)),
        ((1.0, laws[0](1.0, 2.0)), (1.0, laws[1](1.0, 2.0))),
        (kinds[0](1), kinds[1](2)),
    ):
        assert _types(first) != _types(second)


def _types(value: Any) -> str:
    return signature_text((typeof(value),), {})


@pytest.mark.parametrize(
    "around",
    [
        pytest.param(lambda law: [law], id="list"),
        pytest.param(lambda law: {law}, id="set"),
        pytest.param(lambda law: ([law], 3), id="list in a tuple"),
        pytest.param(lambda law: List([law]), id="typed list"),
        pytest.param(lambda law: _typed_dict(law), id="typed dictionary"),
    ],
)
def test_field_order_is_told_within_containers(around: Callable[[Any], Any]) -> None:
    first, second = (LawsA.Law(1.0, 2.0), LawsB.Law(1.0, 2.0))
    assert _types(around(first)) != _types(around(second))


def _typed_dict(law: Any) -> Any:
    made = Dict()
    made[1] = law
    return made


@pytest.mark.parametrize(
    ("first", "second"),
    [
        pytest.param(
            np.array([(1.0, 2.0)], [("a", "f8"), ("b", "f8")])[0],
            np.array([(1.0, 2.0)], [("b", "f8"), ("a", "f8")])[0],
            id="names of a record",
        ),
        pytest.param(np.timedelta64(1, "s"), np.timedelta64(1, "ms"), id="unit of time"),
        pytest.param(0.0, -0.0, id="sign of zero"),
    ],
)
def test_scalars_of_other_meaning_have_other_keys(first: Any, second: Any) -> None:
    keys = set()
    for value in (first, second):

        def reads_it() -> Any:
            return value  # noqa: B023

        keys.add(kernel_key(jit(reads_it), {}))  # type: ignore[arg-type]
    assert len(keys) == 2


def test_a_moved_try_has_another_key(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    keys = set()
    for before, within in (
        ("try:\n        x = a\n        ", ""),
        ("pass\n    x = a\n    try:", ""),
    ):
        text = (
            f"{COMMON}@jit\ndef f(a):\n    {before}{within}\n        y = a\n        return x + y\n"
        )
        text += "    except Exception:\n        return -1\n"
        (tmp_path / "kernel_try.py").write_text(text)
        sys.modules.pop("kernel_try", None)
        importlib.invalidate_caches()
        keys.add(kernel_key(importlib.import_module("kernel_try").f, {}))
    assert len(keys) == 2


def test_a_docstring_that_the_body_returns_counts() -> None:
    @jit
    def old() -> str:
        "abcd"
        return "abcd"

    @jit
    def new() -> str:
        "abcde"
        return "abcde"

    for kernel in (old, new):
        kernel.py_func.__qualname__ = "same"  # type: ignore[attr-defined]
    assert kernel_key(old, {}) != kernel_key(new, {})  # type: ignore[arg-type]


def test_what_no_key_can_hold_is_refused() -> None:
    unknown = object()

    @jit
    def reads_it() -> int:
        return 1 if unknown is None else 2

    with pytest.raises(TypeError, match=r"unknown, a builtins\.object"):
        kernel_key(reads_it, {})  # type: ignore[arg-type]


class _Swap:
    """A global of a kernel's module, changed for a while."""

    def __init__(self, kernel: Dispatcher, name: str, value: Any) -> None:
        self._globals, self._name, self._value = kernel.py_func.__globals__, name, value

    def __enter__(self) -> None:
        self._before = self._globals[self._name]
        self._globals[self._name] = self._value

    def __exit__(self, *_: object) -> None:
        self._globals[self._name] = self._before


def _other_value(value: Any) -> Any:
    """Return a value of other content, or None for a kind that this test doesn't change."""
    if isinstance(value, Dispatcher):
        return _other_kernel(value)
    if isinstance(value, bool):
        return not value
    if isinstance(value, enum.Enum):
        return None
    if isinstance(value, int | float | np.number):
        return next(type(value)(one) for one in (2, 3) if one != value)
    if isinstance(value, np.ndarray):
        return value + 1
    if isinstance(value, type) and hasattr(value, "_fields") and len(value._fields) > 1:
        return namedtuple(value.__name__, value._fields[::-1])  # type: ignore[misc]
    if isinstance(value, tuple) and value and isinstance(value[0], int | float):
        return (value[0] + 1, *value[1:])
    return None


def _other_kernel(kernel: Dispatcher) -> Any:
    def changed() -> int:
        return 12345

    changed.__module__ = kernel.py_func.__module__
    changed.__qualname__ = kernel.py_func.__qualname__
    return jit(changed)


def _takes_in(name: str, home: dict[str, Any], given: str, memo: dict[str, bool]) -> bool:
    """Whether a kernel reads global ``given`` of module ``home``, itself or through callees."""
    if name not in memo:
        memo[name] = False
        kernel = all_kernels()[name]
        read = names_read(kernel)
        memo[name] = (kernel.py_func.__globals__ is home and given in read) or any(
            _takes_in(kernel_name(value), home, given, memo)
            for value in read.values()
            if isinstance(value, Dispatcher)
        )
    return memo[name]


def _changes() -> list[tuple[str, str]]:
    return sorted(
        (kernel, name)
        for kernel in all_kernels()
        for name, value in names_read(all_kernels()[kernel]).items()
        if _other_value(value) is not None
    )


def _check(changes: list[tuple[str, str]]) -> None:
    before = _all_keys()
    for kernel_named, name in changes:
        kernel = all_kernels()[kernel_named]
        home = kernel.py_func.__globals__
        memo: dict[str, bool] = {}
        expected = {one for one in all_kernels() if _takes_in(one, home, name, memo)}
        with _Swap(kernel, name, _other_value(home[name])):
            after = _all_keys()
        assert {one for one in before if before[one] != after[one]} == expected, (
            kernel_named,
            name,
        )


def _all_keys() -> dict[str, str]:
    memo: Any = {}
    return {name: kernel_key(kernel, memo) for name, kernel in all_kernels().items()}


def test_a_change_reaches_just_the_kernels_that_take_it_in() -> None:
    changes = _changes()
    assert len(changes) > 500
    _check(random.Random(1).sample(changes, 3))


@pytest.mark.slow
def test_every_change_reaches_just_the_kernels_that_take_it_in() -> None:
    _check(_changes())


def test_kernels_of_one_name_are_told_by_the_name_that_calls_them() -> None:
    def times(factor: float) -> Any:
        @jit
        def scaled(x: Any) -> Any:
            return x * factor

        return scaled

    def pair(first: Any, second: Any) -> Any:
        @jit
        def both(x: Any) -> Any:
            return first(x) * 10 + second(x)

        return both

    one, two = times(1.0), times(2.0)
    assert kernel_key(pair(one, two), {}) != kernel_key(pair(two, one), {})
    assert kernel_key(pair(one, one), {}) != kernel_key(pair(one, two), {})


def test_an_arrays_order_is_in_the_key() -> None:
    def of(table: np.ndarray) -> Any:
        @jit
        def taken(x: Any) -> Any:
            return table[1, 1] * x

        return taken

    table = np.arange(24.0).reshape(4, 6)[::2, ::2]
    assert kernel_key(of(np.asfortranarray(table)), {}) != kernel_key(of(table), {})
