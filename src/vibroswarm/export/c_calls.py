"""Translation of calls to C: of functions of the program, of ``math``, and of some of Python's own functions.

A ``Value`` is an expression in C with its type (``c_types``). What cannot be translated is refused: ``refuse`` raises
an ``InputError`` with file and line; an assertion after it is only for the type checker.
"""

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
    is_by_reference,
    joined,
    literal,
    widened,
)
from vibroswarm.export.source import MATH, is_function, math_name, plain

BUILT_IN: Final[dict[str, Any]] = {
    "abs": None, "min": None, "max": None, "int": INT, "float": REAL, "bool": BOOL, "round": INT,
}  # fmt: skip
"""Python's own functions that may be called, and the types of their results; None: the type of their arguments. ``int``
and ``round`` of a ``LONG`` stay ``LONG``."""


class Calls(Expressions):
    """Translates the expressions of one function, calls among them."""

    def on_call(self, node: ast.Call) -> Value:
        """Translate a call: of ``math``, of Python's own functions, of a class, or of a function of the program."""
        name = math_name(self.source, node.func)
        if name is not None:
            return self.call_of_math(node, name)
        # Methods, and variables of the function, cannot be called.
        if not isinstance(node.func, ast.Name) or node.func.id in self.types:
            self.refuse(node, f"the call '{ast.unparse(node)[:60]}'")
        called = self.source.space.get(node.func.id)
        if called is None and node.func.id in BUILT_IN:
            return self.call_of_built_in(node, node.func.id)
        # A function that a robot cannot run, because it reads the table of beliefs, is replaced by another.
        called = self.program.replaced.get(plain(called), called)
        if plain(called) is plain(uniform):
            return self.call_of_uniform(node)
        struct = self.program.struct_of.get(called)  # for a call that constructs a row
        # The template has classes, such as ``Message``, that only stand for a strategy's own: they are found by name.
        if struct is None and node.func.id in self.program.row_names:
            struct = self.program.row_names[node.func.id]
        if struct is not None:
            return self.construct(node, struct)
        if is_function(called):
            return self.call_of_function(node, called)
        self.refuse(node, f"the call of '{node.func.id}'")

    def arguments(self, node: ast.Call, count: int) -> list[Value]:
        """Return the arguments of a call that takes ``count`` numbers; refuse any other arguments."""
        if node.keywords or len(node.args) != count:
            self.refuse(node, f"the arguments of '{ast.unparse(node)[:60]}'")
        return self.numbers(node, node.args)

    def call_of_math(self, node: ast.Call, name: str) -> Value:
        """Translate the call of ``math.NAME``, for the names in ``MATH``."""
        if name not in MATH:
            self.refuse(node, f"math.{name}")
        values = self.arguments(node, MATH[name])
        if name in ("degrees", "radians"):
            factor = 180.0 / math.pi if name == "degrees" else math.pi / 180.0
            return Value(f"({as_real(values[0])} * {literal(factor).text})", REAL)
        texts = ", ".join(bare(as_real(value)) for value in values)
        # The result is a whole number, as in Python. ``real`` is its text for uses as a floating-point number, without
        # conversion to an integer and back; adding 0 makes 0 of the -0.0 that C's ``ceil`` returns for -0.5.
        if name in ("floor", "ceil"):
            real = f"vs_{name}({texts})" if name == "floor" else f"(vs_ceil({texts}) + 0)"
            return Value(f"((int64_t)vs_{name}({texts}))", LONG, real=real)
        if name == "sqrt" and values[0].constant is not None:  # the root of a constant is a constant
            if values[0].constant < 0:
                self.refuse(node, f"the root of {values[0].constant}, which is negative")
            return literal(math.sqrt(values[0].constant))
        return Value(f"vs_{name}({texts})", BOOL if name == "isnan" else REAL)

    def call_of_built_in(self, node: ast.Call, name: str) -> Value:
        """Translate ``abs``, ``min``, ``max``, ``int``, ``float``, ``bool`` or ``round``.

        ``min`` and ``max`` of several values become nested calls of the runtime's functions of two.
        """
        if name in ("min", "max"):
            values = self.arguments(node, max(len(node.args), 2))  # two arguments or more
            found = values[0]
            for value in values[1:]:
                # Joined with INT, because truth values count as whole numbers.
                kind = joined(joined(found.type, value.type), INT)
                is_wide = kind == INT and (found.wide or value.wide)
                texts = (bare(as_type(item, LONG if is_wide else kind)) for item in (found, value))
                text = f"vs_{name}{SUFFIX[LONG if is_wide else kind]}({', '.join(texts)})"
                found = widened(text) if is_wide else Value(text, kind)
            return found
        (value,) = self.arguments(node, 1)
        if name == "abs" and value.wide:
            return widened(f"vs_abs_l({bare(value.wide)})")
        if name == "abs":
            kind = joined(value.type, INT)  # a truth value counts as a whole number
            return Value(f"vs_abs{SUFFIX[kind]}({bare(value.text)})", kind)
        if name == "bool" and value.type != BOOL:
            self.refuse(node, "bool() of a number")
        if name in ("bool", "float"):
            return value if value.type == BUILT_IN[name] else Value(as_real(value), REAL)
        if value.type != REAL:  # int() and round() do not change a whole number
            return replace(value, type=joined(value.type, INT), is_place=False)
        # The conversion to an integer cuts decimals off, as ``int`` does.
        return Value(f"((vs_int){'vs_round' if name == 'round' else ''}({value.text}))", INT)

    def call_of_uniform(self, node: ast.Call) -> Value:
        """Translate the call of ``core.rng.uniform``, which the runtime has as ``vs_uniform``."""
        texts = [bare(value.text) for value in self.arguments(node, 6)]
        return Value(f"vs_uniform({', '.join(texts)})", REAL)

    def construct(self, node: ast.Call, struct: Struct) -> Value:
        """Translate the construction of a row: without arguments all zeros, or with all fields given in order.

        Only a named tuple is constructed from its fields.
        """
        if not node.args and not node.keywords:
            return Value(f"({struct.name}){{0}}", struct)
        if not hasattr(struct.source, "_fields"):  # not a named tuple
            self.refuse(node, f"'{ast.unparse(node)[:60]}': such a row is constructed without arguments")
        names = list(struct.source._fields)
        if node.keywords or len(node.args) != len(names):
            self.refuse(node, f"'{ast.unparse(node)[:60]}': not all fields, in order")
        texts = []
        for name, value in zip(names, self.in_any_order(node, node.args), strict=True):
            if name in struct.omitted:  # the struct in C does not have this field, so its value is dropped
                continue
            if isinstance(value.type, CArray):  # C copies no arrays
                size = math.prod(value.type.shape)
                text = "{" + ", ".join(f"{value.text}[{i}]" for i in range(size)) + "}"
            else:
                text = bare(as_type(value, struct.type_of(name)))
            texts.append(f".{identifier(name)} = {text}")
        return Value(f"({struct.name}){{{', '.join(texts)}}}", struct)

    def call_of_function(self, node: ast.Call, called: Any) -> Value:
        """Translate the call of a function of the program; the function itself is translated for these types first.

        Rows and arrays are passed by address. A row that has no address yet, as the result of a call, is stored in a
        variable.
        """
        names = self.program.source(called).names
        given: dict[str, ast.expr] = dict(zip(names, node.args, strict=False))
        given |= {word.arg: word.value for word in node.keywords if word.arg}
        if len(node.args) > len(names) or set(given) != set(names):
            self.refuse(node, f"the arguments of '{ast.unparse(node)[:60]}'")
        before = self.changes
        values = self.in_any_order(node, [given[name] for name in names])
        arguments_change = self.changes > before
        compiled = self.program.function(called, [value.type for value in values], self.source, node)
        if any(compiled.changes):  # the function called may change a row, so this one may too
            self.changes += 1
            self.written.update(
                value.root for value, is_changed in zip(values, compiled.changes, strict=True) if is_changed
            )
        if any(is_by_reference(kind) for kind in compiled.parameters):
            self.calls_with_rows += 1
        texts = []
        for value, kind, is_taken in zip(values, compiled.parameters, compiled.takes, strict=True):
            if not is_taken:
                if arguments_change:  # by this one perhaps: it is computed all the same
                    self.pending.append(f"(void){value.text};")
            elif isinstance(kind, Struct):
                place = value
                if not value.is_place:
                    place = Value(self.hold(value), kind, is_place=True)
                texts.append(address(place))
            else:
                texts.append(bare(as_type(value, kind)))
        return Value(f"{compiled.name}({', '.join(texts)})", compiled.returns)

    def hold(self, value: Value) -> str:
        """Return the name of a new constant that is set to a value before the current statement."""
        self.held += 1
        name = f"held_{self.held}"
        kind = value.type.name if isinstance(value.type, Struct | CTuple) else value.type
        self.pending.append(f"const {kind} {name} = {bare(value.text)};")
        return name

    held: int = 0
    """Number of constants made by ``hold`` so far, which numbers their names."""
