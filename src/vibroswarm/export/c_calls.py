"""Translation of calls to C: of functions of the program, of ``math``, and of some of Python's own functions."""

from __future__ import annotations

import ast
import math
from dataclasses import replace
from typing import Any, Final

from vibroswarm.core.rng import uniform
from vibroswarm.export.c_expressions import Expressions
from vibroswarm.export.c_types import (
    BOOL,
    INT,
    LONG,
    OMITTED,
    REAL,
    SUFFIX,
    CArray,
    CTuple,
    Struct,
    Value,
    address,
    as_real,
    as_type,
    bare,
    identifier,
    joined,
    literal,
    widened,
)
from vibroswarm.export.source import MATH, is_function, math_name, plain

BUILT_IN: Final = ("abs", "min", "max", "int", "float", "bool", "round")
"""Python's own functions that may be called. ``int`` and ``round`` of a ``LONG`` stay ``LONG``."""


class Calls(Expressions):
    """Translates the expressions of one function, calls among them."""

    pending: list[str]
    """Statements in C to write before the current one."""
    held: int = 0
    """Number of constants made by ``hold`` so far, which numbers their names."""
    written: set[str]
    """Names of the parameters whose rows or arrays the function may change."""

    def on_call(self, node: ast.Call) -> Value:
        """Translate a call: of ``math``, of Python's own functions, of a class, or of a function of the program."""
        name = math_name(self.source, node.func)
        if name is not None:
            return self.call_of_math(node, name)
        self.source.require(isinstance(node.func, ast.Name) and node.func.id not in self.types, node)
        called = self.source.space.get(node.func.id)  # type: ignore[attr-defined]
        if called is None:
            return self.call_of_built_in(node, node.func.id)  # type: ignore[attr-defined]
        # A function that a robot cannot run, because it reads the table of beliefs, is replaced by another.
        called = self.program.replaced.get(plain(called), called)
        if plain(called) is plain(uniform):  # the runtime has it
            return Value(f"vs_uniform({', '.join(bare(value.text) for value in self.values(node))})", REAL)
        if called in self.program.struct_of:
            return self.construct(node, self.program.struct_of[called])
        self.source.require(is_function(called), node)
        return self.call_of_function(node, called)

    def values(self, node: ast.Call) -> list[Value]:
        """Return the arguments of a call that takes no words."""
        self.source.require(not node.keywords, node)
        return [self.expression(argument) for argument in node.args]

    def call_of_math(self, node: ast.Call, name: str) -> Value:
        """Translate the call of ``math.NAME``, for the names in ``MATH``."""
        self.source.require(MATH.get(name) == len(node.args), node)
        values = self.values(node)
        if name == "sqrt" and values[0].constant is not None:  # the root of a constant is a constant
            return literal(math.sqrt(values[0].constant))
        texts = ", ".join(bare(as_real(value)) for value in values)
        # The result is a whole number, as in Python. ``real`` is its text for uses as a floating-point number, without
        # conversion to an integer and back; adding 0 makes 0 of the -0.0 that C's ``ceil`` returns for -0.5.
        if name in ("floor", "ceil"):
            real = f"vs_{name}({texts})" if name == "floor" else f"(vs_ceil({texts}) + 0)"
            return Value(f"((int64_t)vs_{name}({texts}))", LONG, real=real)
        return Value(f"vs_{name}({texts})", BOOL if name == "isnan" else REAL)

    def call_of_built_in(self, node: ast.Call, name: str) -> Value:
        """Translate ``abs``, ``min``, ``max``, ``int``, ``float``, ``bool`` or ``round``."""
        values = self.values(node)
        is_one = len(values) == 1 and name not in ("min", "max")
        self.source.require(name in BUILT_IN and (is_one or len(values) > 1), node)
        value, *others = values
        if name in ("abs", "min", "max"):
            for other in others or (None,):
                value = self.call_of_runtime(name, [value] if other is None else [value, other])
            return value
        if name == "float":
            return value if value.type == REAL else Value(as_real(value), REAL)
        if name == "bool":
            self.source.require(value.type == BOOL, node)
            return value
        if value.type != REAL:  # int() and round() do not change a whole number
            return replace(value, type=joined(value.type, INT), is_place=False)
        # The conversion to an integer cuts decimals off, as ``int`` does.
        return Value(f"((vs_int){'vs_round' if name == 'round' else ''}({value.text}))", INT)

    def call_of_runtime(self, name: str, values: list[Value]) -> Value:
        """Return the call of one of the runtime's functions of one or two numbers, for each type of number."""
        kind = joined(joined(values[0].type, values[-1].type), INT)  # truth values count as whole numbers
        is_wide = kind == INT and any(value.wide for value in values)
        kind = LONG if is_wide else kind
        text = f"vs_{name}{SUFFIX[kind]}({', '.join(bare(as_type(value, kind)) for value in values)})"
        return widened(text) if is_wide else Value(text, kind)

    def construct(self, node: ast.Call, struct: Struct) -> Value:
        """Translate the construction of a row: without arguments all zeros, or with all fields given in order."""
        if not node.args and not node.keywords:
            return Value(f"({struct.name}){{0}}", struct)
        names = getattr(struct.source, "_fields", ())
        self.source.require(len(names) == len(node.args), node)
        texts = []
        for name, value in zip(names, self.values(node), strict=True):
            if name in struct.omitted:  # the struct in C does not have this field, so its value is dropped
                continue
            self.source.require(value.type != OMITTED, node)
            text = bare(as_type(value, struct.type_of(name)))
            if isinstance(value.type, CArray):  # C copies no arrays
                text = ", ".join(f"{value.text}[{i}]" for i in range(math.prod(value.type.shape)))
                text = f"{{{text}}}"
            texts.append(f".{identifier(name)} = {text}")
        return Value(f"({struct.name}){{{', '.join(texts)}}}", struct)

    def call_of_function(self, node: ast.Call, called: Any) -> Value:
        """Translate the call of a function of the program, which is translated for these types first."""
        names = self.program.source(called).names
        given = dict(zip(names, node.args, strict=False)) | {
            word.arg: word.value for word in node.keywords if word.arg
        }
        self.source.require(len(node.args) <= len(names) and set(given) == set(names), node)
        values = [self.expression(given[name]) for name in names]
        compiled = self.program.function(called, [value.type for value in values])
        self.source.require(node is self.whole or not any(compiled.changes), node)
        texts = []
        for k, value in enumerate(values):
            kind = compiled.parameters[k]
            if compiled.changes[k]:
                self.written.add(value.root)
            if not compiled.takes[k]:
                continue
            if isinstance(kind, Struct):
                self.source.require(value.is_place or node is self.whole, node)
                texts.append(address(value if value.is_place else self.hold(value)))
            else:
                texts.append(bare(as_type(value, kind)))
        return Value(f"{compiled.name}({', '.join(texts)})", compiled.returns)

    def hold(self, value: Value) -> Value:
        """Return a new constant that is set to a value before the current statement; a product is held in 64 bits."""
        self.held += 1
        name = f"held_{self.held}"
        kind = LONG if value.wide else value.type
        text = kind.name if isinstance(kind, Struct | CTuple) else kind
        self.pending.append(f"const {text} {name} = {bare(as_type(value, kind))};")
        return Value(name, kind)
