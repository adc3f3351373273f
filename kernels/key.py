"""Hash a kernel's bytecode, frozen values, called kernels and compiler versions to a cache key.

Numba compiles bytecode and freezes every global value that the bytecode reads: constants, arrays,
named-tuple classes, enums, and other kernels, which it inlines. So a kernel's machine code is
decided by its own bytecode, by those values, by the same of every kernel that it calls, directly
or not, by the compiler's flags, and by the types that it is called with. Docstrings, comments,
annotations and line numbers don't take part.

A value of a kind that can't be described raises `TypeError`, so that nothing is left out silently.
What can be compiled but not found again safely raises `UnkeepableError`.
"""

from __future__ import annotations

import dis
import enum
import hashlib
import inspect
import platform
import re
import sys
from collections.abc import Iterable, Iterator
from functools import cache
from importlib import import_module
from types import BuiltinFunctionType, CodeType, FunctionType, ModuleType
from typing import TYPE_CHECKING, Any, Final, cast

import numpy as np

if TYPE_CHECKING:
    from numba.core import types
    from numba.core.dispatcher import Dispatcher

_SETTINGS: Final = ("OPT", "BOUNDSCHECK", "LOOP_VECTORIZE", "SLP_VECTORIZE", "DEBUGINFO_DEFAULT")
"""Settings of numba, from its environment variables, that change machine code."""

_PASSES: Final = 2
"""Number of the way in which `kernels.library` and `kernels.dispatcher` compile."""

_EXTERNAL: Final = frozenset({"numpy", "math", "cmath", "numba", "builtins"})
"""Packages whose content is decided by their version, which every key holds."""

_TAKES_CONSTANT: Final = frozenset(dis.hasconst)

_ADDRESS: Final = re.compile(r"\b0x[0-9a-f]{6,}\b")

Memo = dict["Dispatcher", tuple[str, tuple["Dispatcher", ...]]]
"""Description of a kernel alone, and the kernels that it calls directly, by their names' order."""


class UnkeepableError(TypeError):
    """A kernel that would not be the same in another process, so that it isn't kept on disk."""


def kernel_key(kernel: Dispatcher, memo: Memo) -> str:
    """Return the key of ``kernel`` with all that it takes in, 32 hex digits.

    ``memo`` keeps the descriptions of kernels already seen; pass a new one to look again.
    Raises `TypeError` where a kernel takes in a value that can't be described. Raises
    `UnkeepableError` where kernels call each other in a circle (numba's loader crashes on those)
    or stand in a script.
    """
    return digest([_environment(), *content_parts(kernel, memo)])


def content_parts(kernel: Dispatcher, memo: Memo) -> list[str]:
    """Describe ``kernel`` with all that it takes in, but for what compiles it; see `kernel_key`."""
    callees = called_kernels(kernel, memo)
    for callee in callees | {kernel}:
        if callee.py_func.__module__ == "__main__":
            raise UnkeepableError(f"{_function_name(callee.py_func)} stands in a script")
        if any(callee in called_kernels(one, memo) for one in _others(callee, memo)):
            raise UnkeepableError(f"{_function_name(callee.py_func)} is called by what it calls")
    return [_whole(kernel, memo, {})]


def _whole(kernel: Dispatcher, memo: Memo, known: dict[Dispatcher, str]) -> str:
    """Describe a kernel and, each at the name that it is called by, all that it calls."""
    if kernel not in known:
        alone, callees = _alone(kernel, memo)
        inner = ("itself" if one is kernel else _whole(one, memo, known) for one in callees)
        known[kernel] = digest([alone, *inner])
    return known[kernel]


def is_kernel(value: Any) -> bool:
    """Whether a value is numba's dispatcher, or stands for one (`kernels.no_numba`)."""
    return hasattr(value, "py_func") and hasattr(value, "targetoptions")


def _others(kernel: Dispatcher, memo: Memo) -> list[Dispatcher]:
    return [one for one in _alone(kernel, memo)[1] if one is not kernel]


def called_kernels(kernel: Dispatcher, memo: Memo) -> set[Dispatcher]:
    """Return every kernel that ``kernel`` calls, directly or not (itself only by recursion)."""
    reached: set[Dispatcher] = set()
    waiting = list(_alone(kernel, memo)[1])
    while waiting:
        callee = waiting.pop()
        if callee not in reached:
            reached.add(callee)
            waiting.extend(_alone(callee, memo)[1])
    return reached


def signature_text(signature: Iterable[types.Type], memo: Memo) -> str:
    """Describe argument types with all that machine code takes from them.

    Numba's own names leave out a named tuple's field order and an enum's values.
    """
    return ", ".join(_type_text(one, memo) for one in signature)


def _type_text(numba_type: types.Type, memo: Memo, around: tuple[types.Type, ...] = ()) -> str:
    if isinstance(numba_type, _types().Dispatcher):
        return f"kernel {kernel_key(numba_type.dispatcher, memo)}"
    text = str(numba_type)
    if _ADDRESS.search(text):
        raise UnkeepableError(f"type {text} is known to one process only")
    parts = [text]
    instance_class = getattr(numba_type, "instance_class", None)
    if isinstance(instance_class, type):
        parts.append(class_text(instance_class))
    for _, value in sorted(vars(numba_type).items()):
        parts += [
            _type_text(one, memo, (*around, numba_type))
            for one in _types_in(value)
            if one not in around and one != numba_type
        ]
    return f"<{', '.join(parts)}>"


def _types_in(value: Any) -> Iterator[types.Type]:
    if isinstance(value, _types().Type):
        yield value
    elif isinstance(value, tuple | list | dict):
        for one in value.values() if isinstance(value, dict) else value:
            yield from _types_in(one)


def _types() -> Any:
    return import_module("numba.core.types")


@cache
def _environment() -> str:
    numba, llvmlite = import_module("numba"), import_module("llvmlite")
    settings = [
        f"passes={_PASSES}",
        *(f"{name}={getattr(numba.config, name, None)}" for name in _SETTINGS),
    ]
    python = (platform.python_implementation(), platform.python_version())
    versions = (numba.__version__, llvmlite.__version__, np.__version__)
    return " ".join([*python, *versions, *settings])


def _alone(kernel: Dispatcher, memo: Memo) -> tuple[str, tuple[Dispatcher, ...]]:
    """Describe one kernel without its callees; list those it calls."""
    if kernel not in memo:
        function = cast(FunctionType, kernel.py_func)
        texts = [_function_name(function), repr(sorted(kernel.targetoptions.items()))]
        texts += [_code_text(function.__code__)]
        texts += [_value_text(one) for one in (function.__defaults__, function.__kwdefaults__)]
        callees = []
        for name, value in _values_read(function):
            if is_kernel(value):
                callees.append(value)
                texts.append(f"{name}: kernel {_function_name(value.py_func)}")
            else:
                texts.append(f"{name}: {_described(value, name, function)}")
        memo[kernel] = (digest(texts), tuple(callees))
    return memo[kernel]


def _described(value: Any, name: str, function: FunctionType) -> str:
    try:
        return _value_text(value)
    except TypeError as error:
        message = f"kernel {_function_name(function)} takes in {name}, {error}"
        raise type(error)(message) from error


def _values_read(function: FunctionType) -> Iterator[tuple[str, Any]]:
    """Yield each global or closed-over value that a function's bytecode reads, with its name."""
    closed = inspect.getclosurevars(function).nonlocals if function.__closure__ else {}
    seen = {}
    for code in _codes(function.__code__):
        for name, chain, is_global in _names_read(code):
            if name in closed and not is_global:
                value = closed[name]
            elif name in function.__globals__:
                value = function.__globals__[name]
            else:
                continue  # a builtin, or a name of an inner function's own
            for attribute in chain:
                if not isinstance(value, ModuleType) or _is_external(value):
                    break
                value, name = getattr(value, attribute), f"{name}.{attribute}"
            seen[name, is_global] = value
    yield from ((name, value) for (name, _), value in sorted(seen.items(), key=lambda one: one[0]))


def _codes(code: CodeType) -> Iterator[CodeType]:
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _codes(constant)


def _names_read(code: CodeType) -> Iterator[tuple[str, list[str], bool]]:
    """Yield each outer name that is read, the attributes taken from it, and if it's a global."""
    name, chain, is_global = None, list[str](), False
    for instruction in dis.get_instructions(code):
        if name is not None and instruction.opname in ("LOAD_ATTR", "LOAD_METHOD"):
            chain.append(str(instruction.argval))
            continue
        if name is not None:
            yield name, chain, is_global
            name, chain = None, []
        if instruction.opname in (
            "LOAD_GLOBAL",
            "LOAD_NAME",
            "LOAD_DEREF",
            "LOAD_FROM_DICT_OR_DEREF",
        ):
            name = str(instruction.argval)
            is_global = instruction.opname in ("LOAD_GLOBAL", "LOAD_NAME")


def _is_external(value: ModuleType) -> bool:
    return value.__name__.partition(".")[0] in _EXTERNAL


def _code_text(code: CodeType) -> str:
    """Describe a code object without docstring, line numbers and names of local variables."""
    constants = list(code.co_consts)
    if constants and isinstance(constants[0], str) and not _loads_first_constant(code):
        constants[0] = None  # the docstring
    inner = [
        _code_text(one) if isinstance(one, CodeType) else _value_text(one) for one in constants
    ]
    arguments = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
    shape = (code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount, code.co_flags)
    names = (arguments, code.co_names, code.co_freevars, code.co_cellvars)
    exceptions = getattr(code, "co_exceptiontable", b"")
    return digest([code.co_code.hex(), exceptions.hex(), repr(shape), repr(names), *inner])


def _loads_first_constant(code: CodeType) -> bool:
    # Read as bytes, of which every second one is an argument: ten times as fast as by `dis`.
    operations, arguments = code.co_code[::2], code.co_code[1::2]
    return any(
        arguments[place] == 0
        and operation in _TAKES_CONSTANT
        and not (place and operations[place - 1] == dis.EXTENDED_ARG)
        for place, operation in enumerate(operations)
    )


def _value_text(value: Any) -> str:
    """Describe a frozen value; raise `TypeError` for a kind that isn't known."""
    if isinstance(value, enum.Enum):
        return f"{class_text(type(value))}.{value.name}"
    if value is None or value is Ellipsis or isinstance(value, bool | int | str | bytes):
        return f"{type(value).__name__} {value!r}"
    if isinstance(value, float | complex | np.generic):
        return _number_text(value)
    if isinstance(value, tuple | list | frozenset):
        return _collection_text(value)
    if isinstance(value, dict):
        return f"dict {[(repr(key), _value_text(one)) for key, one in value.items()]}"
    if isinstance(value, np.ndarray):
        data = hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()
        order = f"{value.flags.c_contiguous} {value.flags.f_contiguous}"
        return f"array {value.dtype.descr!r} {value.shape} {order} {data}"
    if isinstance(value, np.dtype):
        return f"dtype {value.descr!r} {value.itemsize}"
    if "numba.core.types" in sys.modules and isinstance(value, _types().Type):
        return f"type {value}"
    if isinstance(value, type):
        return class_text(value)
    if isinstance(value, ModuleType) and _is_external(value):
        return f"module {value.__name__}"
    if callable(value) and str(getattr(value, "__module__", "")).partition(".")[0] in _EXTERNAL:
        return f"function {value.__module__}.{getattr(value, '__name__', value)}"
    if isinstance(value, BuiltinFunctionType):
        return f"function {value.__module__}.{value.__qualname__}"
    message = f"a {type(value).__module__}.{type(value).__qualname__}, which no cache key can hold"
    raise TypeError(message)


def _number_text(value: Any) -> str:
    kind = f"{type(value).__module__}.{type(value).__name__}"
    array = np.asarray(value)
    return f"{kind} {array.dtype.descr!r} {array.tobytes().hex()}"


def _collection_text(value: Any) -> str:
    kind = class_text(type(value)) if hasattr(value, "_fields") else type(value).__name__
    items = [_value_text(one) for one in value]
    return f"{kind} {sorted(items) if isinstance(value, frozenset) else items}"


def class_text(value: Any) -> str:
    """Describe a class by its name and what it holds; raise `TypeError` for an unknown kind."""
    name = f"class {value.__module__}.{value.__qualname__}"
    if value.__module__ == "__main__" or "<locals>" in value.__qualname__:
        raise UnkeepableError(f"{name} can't be found by its name in another process")
    if issubclass(value, enum.Enum):
        members = [(key, _value_text(one.value)) for key, one in value.__members__.items()]
        return f"{name} {members}"
    if issubclass(value, tuple) and hasattr(value, "_fields"):
        defaults = [(key, _value_text(one)) for key, one in value._field_defaults.items()]
        return f"{name} {value._fields} {defaults}"
    if value.__module__.partition(".")[0] in _EXTERNAL or issubclass(value, BaseException):
        return name
    message = f"class {value.__module__}.{value.__qualname__}, which no cache key can hold"
    raise TypeError(message)


def _function_name(function: Any) -> str:
    return f"{function.__module__}.{function.__qualname__}"


def digest(texts: Iterable[str]) -> str:
    """Return a digest of texts, in their order, 32 hex digits."""
    hasher = hashlib.sha256()
    for text in texts:
        hasher.update(f"{len(text)}:{text}".encode())
    return hasher.hexdigest()[:32]
