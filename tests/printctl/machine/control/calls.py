"""Find calls of steps in source text: whose method a call is, by the receiver's name."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

ROOM = "printctl.machine.control."
STEP_CLASSES = {
    "position": "PositionCheck",
    "frame": "FrameCheck",
    "channel": "Channel",
    "firmware": "FirmwareCheck",
    "heat": "HeatCheck",
    "slips": "SlipWatch",
    "standby": "Standby",
    "rest": "RestWait",
    "kill": "Kill",
    "idle": "IdleCommands",
}
"""Classes with steps by the names that their objects have in the room and its callers."""
OTHERS = frozenset(
    {"watch", "logbook", "streamer", "machine", "standstills", "halted", "bell", "keeper"}
    | {"listener", "handler", "stop", "known", "server", "contact", "book"}
)
"""Names of objects without steps, whose methods may be called as a step is."""


@dataclass
class Function:
    """A function, and whether it returns steps."""

    node: ast.FunctionDef

    @property
    def waits(self) -> bool:
        returns = self.node.returns
        return returns is not None and ast.unparse(returns).startswith("Steps[")


@dataclass
class Source:
    """One module's functions, classes and imports from the room."""

    module: str
    tree: ast.Module
    functions: dict[str, Function] = field(default_factory=dict)
    classes: dict[str, dict[str, Function]] = field(default_factory=dict)
    bases: dict[str, list[str]] = field(default_factory=dict)
    imports: dict[str, tuple[str, str]] = field(default_factory=dict)

    @staticmethod
    def read(path: Path) -> Source:
        parts = path.with_suffix("").parts
        module = ".".join(parts[len(parts) - 1 - parts[::-1].index("printctl") :])
        return Source.parse(module, path.read_text())

    @staticmethod
    def parse(module: str, text: str) -> Source:
        one = Source(module, ast.parse(text))
        for node in one.tree.body:
            if isinstance(node, ast.FunctionDef):
                one.functions[node.name] = Function(node)
            elif isinstance(node, ast.ClassDef):
                methods = [each for each in node.body if isinstance(each, ast.FunctionDef)]
                one.classes[node.name] = {each.name: Function(each) for each in methods}
                one.bases[node.name] = [ast.unparse(base) for base in node.bases]
            elif isinstance(node, ast.ImportFrom) and (node.module or "").startswith(ROOM):
                for alias in node.names:
                    one.imports[alias.asname or alias.name] = (node.module or "", alias.name)
        return one


def forgotten(sources: Sequence[Source]) -> list[str]:
    """Calls of steps that are neither behind ``yield from`` nor given to a shell's ``drive``."""
    house = _House(sources)
    return [
        f"{source.module}:{call.lineno}: {words}"
        for source in sources
        for call, owner, given in _calls(source.tree)
        if (words := house.complaint(source, owner, call, given))
    ]


class _House:
    def __init__(self, sources: Sequence[Source]) -> None:
        self.modules = {one.module: one for one in sources}
        self.classes = {name: (one, name) for one in sources for name in one.classes}
        self.step_methods = {
            name
            for one in sources
            for methods in one.classes.values()
            for name, function in methods.items()
            if function.waits
        }

    def complaint(self, source: Source, owner: str, call: ast.Call, given: bool) -> str:
        called = call.func
        if isinstance(called, ast.Name):
            function = source.functions.get(called.id)
            if function is None and called.id in source.imports:
                module, name = source.imports[called.id]
                there = self.modules.get(module)
                function = there.functions.get(name) if there is not None else None
            waits = function is not None and function.waits
            return "" if given or not waits else ast.unparse(call)
        if not isinstance(called, ast.Attribute) or called.attr not in self.step_methods:
            return ""
        kind = self._kind(called.value, owner)
        if kind is None:
            return f"whose is {ast.unparse(call)}"
        method = self._method(kind, called.attr)
        return "" if given or method is None or not method.waits else ast.unparse(call)

    def _kind(self, receiver: ast.expr, owner: str) -> str | None:
        """The class of a call's receiver; empty for one without steps, None for unknown."""
        if isinstance(receiver, ast.Name) and receiver.id == "self":
            return owner
        if isinstance(receiver, ast.Call) and ast.unparse(receiver.func) == "super":
            there, _ = self.classes[owner]
            return next(iter(there.bases[owner]), "")
        last = getattr(receiver, "attr", getattr(receiver, "id", "")).lstrip("_")
        return "" if last in OTHERS else STEP_CLASSES.get(last)

    def _method(self, kind: str, name: str) -> Function | None:
        while kind in self.classes:
            there, _ = self.classes[kind]
            if name in there.classes[kind]:
                return there.classes[kind][name]
            kind = next(iter(there.bases[kind]), "")
        return None


def _calls(tree: ast.Module) -> Iterator[tuple[ast.Call, str, bool]]:
    """Each call, the class in whose body it is, and whether it is waited for or driven."""
    stack: list[tuple[ast.AST, str, bool]] = [(tree, "", False)]
    found: list[tuple[ast.Call, str, bool]] = []
    while stack:
        node, owner, given = stack.pop()
        if isinstance(node, ast.Call):
            found.append((node, owner, given))
        inside = node.name if isinstance(node, ast.ClassDef) else owner
        drives = isinstance(node, ast.Call) and ast.unparse(node.func).split(".")[-1] == "drive"
        for child in ast.iter_child_nodes(node):
            waited = isinstance(node, ast.YieldFrom) or (drives and child in node.args)
            stack.append((child, inside, waited))
    return iter(sorted(found, key=lambda one: (one[0].lineno, one[0].col_offset)))
