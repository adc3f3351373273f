"""Read and write `needed.jsonl`: the kernels that each command needs, with argument types.

Written by ``python -m tests.kernels.record``, which does the work once without any compiled
kernel. A kernel that isn't listed is compiled when it is first called, as everywhere in numba;
the list only lets all cores do it beforehand. Callees stand before their callers.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, Final

import numpy as np

LIST: Final = Path(__file__).with_name("needed.jsonl")


@dataclass(frozen=True)
class NeededKernel:
    """A kernel and the argument types that it is compiled for.

    Attributes
    ----------
    kernel : str
        Module and function, with a colon between.
    takes : str
        Argument types as JSON (`types_text`).
    by : frozenset of str
        The kinds of work that need it: ``run fresh``, ``register`` and so on.
    entry : bool
        Whether Python calls it; else only other kernels do (`kernels.dispatcher`).
    """

    kernel: str
    takes: str
    by: frozenset[str]
    entry: bool = False


def needed_kernels(*works: str) -> list[NeededKernel]:
    """Return what ``works`` need; with none given all that is listed. Empty without the list."""
    if not LIST.is_file():
        return []
    return [one for one in _listed() if not works or one.by & set(works)]


def _listed() -> Iterator[NeededKernel]:
    for line in LIST.read_text(encoding="utf-8").splitlines():
        data = json.loads(line)
        takes, by = json.dumps(data["takes"]), frozenset(data["by"])
        yield NeededKernel(data["kernel"], takes, by, data["entry"])


def write(rows: Iterable[NeededKernel], path: Path = LIST) -> None:
    """Write the list anew."""
    lines = [
        json.dumps(
            {
                "kernel": one.kernel,
                "entry": one.entry,
                "by": sorted(one.by),
                "takes": json.loads(one.takes),
            }
        )
        for one in rows
    ]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def types_text(signature: Iterable[Any]) -> str:
    """Return numba's argument types as JSON; raise `TypeError` for a kind that isn't known."""
    return json.dumps([_described(one) for one in signature])


def types_of(text: str) -> tuple[Any, ...]:
    """Return numba's argument types of `types_text`.

    Raises `ImportError` or `AttributeError` where a class is no longer there.
    """
    return tuple(_numba_type(one) for one in json.loads(text))


def _numba(module: str) -> Any:
    """A module of numba, once types are asked for: reading the list alone needs none."""
    return import_module(f"numba.{module}")


def _described(one: Any) -> Any:
    types = _numba("core.types")
    if isinstance(one, types.Bytes):
        return {"bytes": one.dtype.name}
    # Numba calls arrays of packed records unaligned; other unaligned arrays stand within a record.
    if type(one) is types.Array and one.aligned == types.Array(one.dtype, 1, "C").aligned:
        shape = [one.ndim, one.layout, *([] if one.mutable else ["readonly"])]
        return {"array": [_described(one.dtype), *shape]}
    if isinstance(one, types.BaseTuple):
        items = [_described(item) for item in one]
        if not isinstance(one, types.BaseNamedTuple):
            return {"tuple": items}
        named = one.instance_class
        return {"named": [f"{named.__module__}:{named.__qualname__}", items]}
    if isinstance(one, types.Record):
        return {"record": _fields(_numba("np.numpy_support").as_dtype(one))}
    numbers = types.Integer | types.Float | types.Complex | types.Boolean
    plain = isinstance(one, numbers | types.NoneType)
    if plain and not isinstance(one, types.Literal):
        return {types.boolean: "boolean", types.none: "none"}.get(one, one.name)
    raise TypeError(f"numba type {one}, which the list of kernels can't hold")


def _numba_type(data: Any) -> Any:
    types = _numba("core.types")
    if isinstance(data, str):
        return getattr(types, data)
    ((kind, value),) = data.items()
    if kind == "bytes":
        return types.Bytes(getattr(types, value), 1, "C")
    if kind == "array":
        dtype, ndim, layout, *flags = value
        return types.Array(_numba_type(dtype), ndim, layout, readonly="readonly" in flags)
    if kind == "tuple":
        return types.BaseTuple.from_types([_numba_type(one) for one in value])
    if kind == "named":
        items = [_numba_type(one) for one in value[1]]
        return types.BaseTuple.from_types(items, resolve_name(value[0]))
    return _record(value)


def _fields(dtype: Any) -> list[Any]:
    """Size and alignment of a record, and of each field name, type, shape and offset."""
    fields = [
        [name, field.base.str, list(field.shape), offset]
        for name, (field, offset) in dtype.fields.items()
    ]
    return [dtype.itemsize, dtype.isalignedstruct, fields]


def _record(data: list[Any]) -> Any:
    size, aligned, fields = data
    names, forms, shapes, offsets = zip(*fields, strict=True)
    formats = [(form, tuple(shape)) for form, shape in zip(forms, shapes, strict=True)]
    parts: Any = {"names": names, "formats": formats, "offsets": offsets, "itemsize": size}
    return _numba("np.numpy_support").from_dtype(np.dtype(parts, align=aligned))


def resolve_name(name: str) -> Any:
    """Return what ``name`` (module, colon, name) stands for."""
    module, _, attribute = name.partition(":")
    return getattr(import_module(module), attribute)
