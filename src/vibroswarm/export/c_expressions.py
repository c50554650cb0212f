"""Translation of expressions to C; types follow from those of the function's arguments, as in Numba.

The method ``on_NODE`` translates syntax trees of the class NODE. C leaves the order open in which it computes the
parts of an expression, so a call that may change a row must be all of what a statement computes (``whole``).
"""

from __future__ import annotations

import ast
import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

from vibroswarm.export.c_types import (
    BOOL,
    INT,
    INTEGERS,
    LONG,
    OMITTED,
    REAL,
    STORED,
    SUFFIX,
    CArray,
    Struct,
    Value,
    as_real,
    as_type,
    bare,
    identifier,
    joined,
    literal,
    widened,
)
from vibroswarm.export.source import Source, math_name, number_of

if TYPE_CHECKING:
    from vibroswarm.export.c_functions import Program

BINARY: Final = {
    ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.BitAnd: "&", ast.BitOr: "|", ast.BitXor: "^",
    ast.LShift: "<<", ast.RShift: ">>",
}  # fmt: skip
"""Operators that become an operator in C, and how they are written there."""
COMPARE: Final = {
    ast.Eq: "==", ast.NotEq: "!=", ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=",
}  # fmt: skip
"""Comparisons that can be translated, and how they are written in C."""


class Expressions:
    """Translates the expressions of one function."""

    program: Program
    """The functions translated so far, to which the functions called are added."""
    source: Source
    """The function that is translated, with its source."""
    types: dict[str, Any]
    """Types of parameters and local variables, by name."""
    whole: ast.expr | None
    """All of what the current statement computes, if a call that may change a row may stand there."""

    def expression(self, node: ast.expr) -> Value:
        """Return the translation of an expression, by the method for its class of syntax tree."""
        method: Any = getattr(self, f"on_{type(node).__name__.lower()}", None)
        self.source.require(method is not None, node)
        found: Value = method(node)
        return found

    def truth(self, node: ast.expr) -> Value:
        """Return the translation of an expression that must be a truth value."""
        value = self.expression(node)
        self.source.require(value.type == BOOL, node)
        return value

    def number(self, value: Any, node: ast.expr) -> Value:
        """Return a number or truth value of Python as a constant; ``node`` is the expression that it is of."""
        number = number_of(value)
        self.source.require(number is not None, node)
        return literal(number)  # type: ignore[arg-type]

    def on_constant(self, node: ast.Constant) -> Value:
        """Translate a number or truth value."""
        return self.number(node.value, node)

    def on_name(self, node: ast.Name) -> Value:
        """Translate the name of a variable, a constant row or a global number."""
        name, text = node.id, identifier(node.id)
        if name in self.types:
            kind = self.types[name]
            is_row, is_parameter = isinstance(kind, Struct), name in self.source.names
            root = name if is_parameter else ""
            if is_row and is_parameter:
                return Value(f"(*{text})", kind, is_place=True, pointer=text, root=root)
            return Value(text, kind, is_place=is_row, root=root)
        if name in self.program.globals:
            return self.program.globals[name]
        value = self.number(self.source.space.get(name), node)
        return replace(value, text=f"VS_{name}") if self.program.enums.get(name) == value.constant else value

    def on_attribute(self, node: ast.Attribute) -> Value:
        """Translate a field of a row, the size of an array, or a constant of ``math``."""
        name = math_name(self.source, node)
        if name is not None:
            return self.number(getattr(math, name), node)
        row = self.expression(node.value)
        if isinstance(row.type, CArray) and node.attr == "size":
            return literal(math.prod(row.type.shape))
        self.source.require(isinstance(row.type, Struct), node)
        if node.attr in row.type.omitted:
            return Value("", OMITTED)
        kind = row.type.type_of(node.attr)
        self.source.require(kind is not None, node)
        place = f"{row.pointer}->" if row.pointer else f"{row.text}."
        return Value(place + identifier(node.attr), kind, is_place=True, root=row.root)

    def on_subscript(self, node: ast.Subscript) -> Value:
        """Translate an element of an array; a negative index would count from the end in Python, but not in C."""
        array = self.expression(node.value)
        self.source.require(isinstance(array.type, CArray), node)
        indices = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        text = array.text
        for index, size in zip(indices, array.type.shape, strict=True):
            value = self.expression(index)
            self.source.require(value.constant is None or 0 <= value.constant < size, node)
            text += f"[{bare(value.text)}]"
        is_stored, is_read = array.type.element == STORED, isinstance(node.ctx, ast.Load)
        text = f"VS_LOAD({text})" if is_stored and is_read else text
        # ``is_place`` matters only for an element that is a row, which is passed by address and never converted.
        is_target = is_stored and not is_read
        return Value(text, array.type.number, is_place=True, is_stored=is_target, root=array.root)

    def on_unaryop(self, node: ast.UnaryOp) -> Value:
        """Translate ``-x`` or ``not x``."""
        if isinstance(node.op, ast.Not):
            value = self.truth(node.operand)
            return Value(f"(!{value.text})", BOOL) if value.constant is None else literal(not value.constant)
        self.source.require(isinstance(node.op, ast.USub), node)
        value = self.expression(node.operand)
        if value.constant is not None:
            return literal(-value.constant)
        # A product that may need more than 32 bits does so also with the other sign. A difference from 0 is never -0.0,
        # which a whole number cannot be.
        real, wide = (f"(0 - {text})" if text else "" for text in (value.real, value.wide))
        return Value(f"(-{value.text})", joined(value.type, INT), real=real, wide=wide)

    def on_binop(self, node: ast.BinOp) -> Value:
        """Translate an operator of two numbers."""
        return self.arithmetic(node, node.op, self.expression(node.left), self.expression(node.right))

    def arithmetic(self, node: ast.AST, operator: ast.operator, left: Value, right: Value) -> Value:
        """Return the result of an operator, with Python's meaning of division and remainder."""
        if left.constant is not None and right.constant is not None:
            return literal(computed(ast.BinOp(constant(left), operator, constant(right))))
        both = joined(joined(left.type, right.type), INT)  # truth values count as whole numbers
        kind = type(operator)
        self.source.require(both in (*INTEGERS, REAL), node)
        if kind is ast.Div:
            return Value(f"({as_real(left)} / {as_real(right)})", REAL)
        if both == REAL:
            return self.of_reals(node, kind, left, right)
        return self.of_whole(node, kind, left, right, both)

    def of_reals(self, node: ast.AST, kind: type[ast.operator], left: Value, right: Value) -> Value:
        """Return the result of an operator of numbers one of which is floating-point."""
        if kind in BINARY:
            return Value(f"({as_real(left)} {BINARY[kind]} {as_real(right)})", REAL)
        if kind is ast.Pow and right.type in INTEGERS:
            return Value(f"vs_power({bare(left.text)}, {bare(as_type(right, LONG))})", REAL)
        self.source.require(kind in (ast.Pow, ast.Mod), node)
        name = "vs_pow" if kind is ast.Pow else "vs_mod"
        return Value(f"{name}({bare(as_real(left))}, {bare(as_real(right))})", REAL)

    def of_whole(
        self, node: ast.AST, kind: type[ast.operator], left: Value, right: Value, both: str
    ) -> Value:
        """Return the result of an operator of whole numbers, in 64 bits where one of them might overflow 32 bits."""
        self.source.require(kind in BINARY or kind in (ast.Mod, ast.FloorDiv), node)
        is_product, is_wide = kind is ast.Mult and both == INT, bool(left.wide or right.wide)
        texts = [as_type(value, LONG if is_wide else both) for value in (left, right)]
        if kind in BINARY:
            text = f"({texts[0]} {BINARY[kind]} {texts[1]})"
        else:
            name = "vs_mod" if kind is ast.Mod else "vs_floordiv"
            text = f"{name}{SUFFIX[LONG if is_wide else both]}({', '.join(map(bare, texts))})"
        if is_product:
            return Value(
                f"({left.text} * {right.text})",
                INT,
                real=f"({as_real(left)} * {as_real(right)})",
                wide=f"({left.wide or f'(int64_t){left.text}'} * {as_type(right, LONG)})",
            )
        if not is_wide or both == LONG:
            return Value(text, both)
        found = widened(text)
        if kind in (ast.Add, ast.Sub):
            return replace(found, text=f"({left.text} {BINARY[kind]} {right.text})")
        return found

    def on_boolop(self, node: ast.BoolOp) -> Value:
        """Translate ``and`` and ``or``; operands that are constant and do not decide the result are left out."""
        stops_at = isinstance(node.op, ast.Or)
        texts: list[str] = []
        for operand in node.values:
            value = self.truth(operand)
            # A constant that decides the result is the result, unless operands before it must still be evaluated.
            if value.constant is not None and bool(value.constant) == stops_at and not texts:
                return literal(stops_at)
            if value.constant is None or bool(value.constant) == stops_at:
                texts.append(value.text)
        if not texts:
            return literal(not stops_at)
        text = (" || " if stops_at else " && ").join(texts)
        return Value(f"({text})" if len(texts) > 1 else text, BOOL)

    def on_compare(self, node: ast.Compare) -> Value:
        """Translate a comparison, or a chain such as ``a < b < c``, which becomes several comparisons."""
        self.source.require(all(type(operator) in COMPARE for operator in node.ops), node)
        values = [self.expression(item) for item in (node.left, *node.comparators)]
        if all(value.constant is not None for value in values):
            first, *others = map(constant, values)
            return literal(computed(ast.Compare(first, node.ops, others)))
        pairs = zip(values, node.ops, values[1:], strict=False)
        parts = [compared(left, COMPARE[type(op)], right) for left, op, right in pairs]
        return Value(parts[0] if len(parts) == 1 else f"({' && '.join(parts)})", BOOL)

    def on_ifexp(self, node: ast.IfExp) -> Value:
        """Translate ``a if test else b`` for two numbers; if the test is constant, only the value chosen."""
        test = self.truth(node.test)
        if test.constant is not None:
            return self.expression(node.body if test.constant else node.orelse)
        first, second = self.expression(node.body), self.expression(node.orelse)
        kind = joined(first.type, second.type)
        self.source.require(kind in (BOOL, *INTEGERS, REAL), node)
        is_wide = kind == INT and bool(first.wide or second.wide)
        texts = [as_type(value, LONG if is_wide else kind) for value in (first, second)]
        text = f"({test.text} ? {texts[0]} : {texts[1]})"
        return widened(text) if is_wide else Value(text, kind)


def constant(value: Value) -> ast.expr:
    """Return the number of a constant as an expression of Python."""
    return ast.Constant(value.constant)


def computed(folded: ast.expr) -> Any:
    """Return the value of an expression of numbers and operators."""
    text = compile(ast.fix_missing_locations(ast.Expression(folded)), "constant", "eval")
    return eval(text, {})  # noqa: S307 - numbers and operators only


def compared(left: Value, operator: str, right: Value) -> str:
    """Return a comparison of two numbers: as floating-point numbers if one of them is."""
    # Products are compared in 64 bits, where 32 bits might overflow.
    kind = REAL if joined(left.type, right.type) == REAL else LONG
    return f"({as_type(left, kind)} {operator} {as_type(right, kind)})"
