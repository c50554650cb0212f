"""Expressions of the robot's program in C. What is not known here is refused with its file and line.

Types follow from the arguments, as Numba's do: ``int`` is ``vs_int`` (32 bits), ``float`` is ``vs_real`` (float or
double).
"""

from __future__ import annotations

import ast
import math
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
    field_of,
    identifier,
    joined,
    literal,
)
from vibroswarm.export.source import Source, math_name, number_of

if TYPE_CHECKING:
    from vibroswarm.export.c_functions import Program

BINARY: Final = {
    ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.BitAnd: "&", ast.BitOr: "|", ast.BitXor: "^",
    ast.LShift: "<<", ast.RShift: ">>",
}  # fmt: skip
OF_INTEGERS: Final = (ast.BitAnd, ast.BitOr, ast.BitXor, ast.LShift, ast.RShift)
COMPARE: Final = {
    ast.Eq: "==", ast.NotEq: "!=", ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=",
}  # fmt: skip


class Expressions:
    """Translates the expressions of one function."""

    program: Program
    source: Source
    types: dict[str, Any]
    """Of parameters and local variables."""
    aliases: dict[str, Value]
    """Local names of rows and arrays."""
    loops: list[str]
    """Variables of the loops around."""
    pending: list[str]
    """Statements that come before the one under way."""
    changes: int = 0
    """Calls so far that may change a row."""
    writes: bool = False
    """Whether the function may change a row."""

    def refuse(self, node: ast.AST, why: str) -> Any:
        """Refuse a construct."""
        raise self.source.refusal(node, why)

    def expression(self, node: ast.expr) -> Value:
        """Return an expression in C."""
        method: Any = getattr(self, f"on_{type(node).__name__.lower()}", None)
        if method is None:
            self.refuse(node, f"{type(node).__name__} '{ast.unparse(node)[:60]}'")
        found: Value = method(node)
        return found

    def number(self, node: ast.expr) -> Value:
        """Return an expression that must be a number."""
        value = self.expression(node)
        if value.type not in (INT, LONG, REAL, BOOL):
            self.refuse(node, f"'{ast.unparse(node)[:60]}' is not a number")
        return value

    def in_any_order(self, node: ast.AST, items: list[ast.expr]) -> list[Value]:
        """Return expressions that C may compute in any order: if one changes a row, no other may change or read one."""
        found, changing = [], set[int]()
        for k, item in enumerate(items):
            before = self.changes
            found.append(self.expression(item))
            if self.changes > before:
                changing.add(k)
        if len(changing) > 1:
            self.refuse(node, "two calls that may change a row in one expression, whose order C leaves open")
        if changing and any(self.reads_row(item) for k, item in enumerate(items) if k not in changing):
            self.refuse(node, "a call that may change a row beside a field, in an order that C leaves open")
        return found

    def reads_row(self, item: ast.expr) -> bool:
        """Return whether an expression reads a field that a call might change."""
        for part in ast.walk(item):
            root: ast.AST = part
            while isinstance(root, ast.Attribute | ast.Subscript):
                root = root.value
            if root is part or not isinstance(root, ast.Name) or not isinstance(part, ast.expr):
                continue
            kind = self.types.get(root.id)
            of_row = isinstance(kind, CArray) or (isinstance(kind, Struct) and kind.mutable)
            is_size = isinstance(part, ast.Attribute) and part.attr in ("size", "shape")
            if is_size or not (of_row or root.id in self.aliases):
                continue
            if not isinstance(self.expression(part).type, Struct | CArray):
                return True
        return False

    def numbers(self, node: ast.AST, items: list[ast.expr]) -> list[Value]:
        """Return expressions that must be numbers, computed in any order."""
        values = self.in_any_order(node, items)
        for item, value in zip(items, values, strict=True):
            if value.type not in (INT, LONG, REAL, BOOL):
                self.refuse(item, f"'{ast.unparse(item)[:60]}' is not a number")
        return values

    def truth(self, node: ast.expr) -> Value:
        """Return an expression that must be true or false."""
        value = self.expression(node)
        if value.type != BOOL:
            self.refuse(node, f"'{ast.unparse(node)[:60]}' is not a comparison")
        return value

    def on_constant(self, node: ast.Constant) -> Value:
        """Translate a number."""
        number = number_of(node.value)
        if number is None:
            self.refuse(node, f"the constant {node.value!r}")
        return literal(number)  # type: ignore[arg-type]

    def on_name(self, node: ast.Name) -> Value:
        """Translate a variable or a global constant."""
        name = node.id
        if name in self.aliases:
            return self.aliases[name]
        if name in self.types:
            kind = self.types[name]
            if name in self.program_loops and name not in self.loops:
                self.refuse(node, f"the variable '{name}' of a loop is read after it")
            if isinstance(kind, Struct) and name in self.parameters:
                return Value(f"(*{identifier(name)})", kind, is_place=True)
            return Value(identifier(name), kind, is_place=isinstance(kind, Struct))
        if name in self.program.globals:
            return self.program.globals[name]
        if name in self.source.space:
            number = number_of(self.source.space[name])
            if number is not None:
                return literal(number)
        self.refuse(node, f"the name '{name}', which is no number, variable or row")
        raise AssertionError

    @property
    def parameters(self) -> set[str]:
        """Names of the function's parameters."""
        return {argument.arg for argument in self.source.tree.args.args}

    @property
    def program_loops(self) -> set[str]:
        """Names of the variables of all loops of the function."""
        return {
            node.target.id
            for node in ast.walk(self.source.tree)
            if isinstance(node, ast.For) and isinstance(node.target, ast.Name)
        }

    def on_attribute(self, node: ast.Attribute) -> Value:
        """Translate a field of a row, a size of an array or a constant of ``math``."""
        name = math_name(self.source, node)
        if name is not None:
            number = number_of(getattr(math, name, None))
            if number is None:
                self.refuse(node, f"math.{name}")
            return literal(number)  # type: ignore[arg-type]
        row = self.expression(node.value)
        if isinstance(row.type, CArray) and node.attr == "size":
            return literal(math.prod(row.type.shape))
        if not isinstance(row.type, Struct):
            self.refuse(node, f"'{ast.unparse(node)}'")
        if node.attr in row.type.omitted:
            return Value("", OMITTED)
        kind = row.type.type_of(node.attr)
        if kind is None:
            self.refuse(node, f"the field '{node.attr}', which {row.type.name} has not")
        number_kind = kind if isinstance(kind, Struct | CArray) or kind in (REAL, BOOL, LONG) else INT
        return Value(field_of(row.text, node.attr), number_kind, is_place=True)

    def on_subscript(self, node: ast.Subscript) -> Value:
        """Translate an element of an array, or a length ``.shape[0]``."""
        if isinstance(node.value, ast.Attribute) and node.value.attr == "shape":
            array, axis = self.expression(node.value.value), self.expression(node.slice).constant
            if not isinstance(array.type, CArray) or axis is None:
                self.refuse(node, f"'{ast.unparse(node)}'")
            return literal(array.type.shape[int(axis)])  # type: ignore[arg-type]
        array = self.expression(node.value)
        if not isinstance(array.type, CArray):
            self.refuse(node, f"'{ast.unparse(node)}': not an array")
        indices = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        if len(indices) != len(array.type.shape):
            self.refuse(node, f"'{ast.unparse(node)}': {len(indices)} of {len(array.type.shape)} indices")
        text = array.text
        for k, index in enumerate(indices):
            value = self.number(index)
            if value.type == REAL:
                self.refuse(index, f"the index '{ast.unparse(index)}' is not a whole number")
            if value.constant is not None and not 0 <= value.constant < array.type.shape[k]:
                self.refuse(index, f"the index {value.constant} of an array of {array.type.shape[k]}")
            text += f"[{value.text}]"
        if array.type.element == STORED and isinstance(node.ctx, ast.Load):
            text = f"VS_LOAD({text})"
        return Value(text, array.type.number, is_place=True)

    def on_unaryop(self, node: ast.UnaryOp) -> Value:
        """Translate a sign or ``not``."""
        if isinstance(node.op, ast.Not):
            value = self.truth(node.operand)
            if value.constant is not None:
                return literal(not value.constant)
            return Value(f"(!{value.text})", BOOL)
        value = self.number(node.operand)
        if not isinstance(node.op, ast.USub):
            self.refuse(node, f"the operator in '{ast.unparse(node)[:60]}'")
        if value.constant is not None:
            return literal(-value.constant)
        return Value(f"(-{value.text})", joined(value.type, INT))

    def on_binop(self, node: ast.BinOp) -> Value:
        """Translate arithmetic."""
        left, right = self.numbers(node, [node.left, node.right])
        return self.arithmetic(node, node.op, left, right)

    def arithmetic(self, node: ast.AST, operator: ast.operator, left: Value, right: Value) -> Value:
        """Return the result of an operator, with Python's meaning of division and remainder."""
        if left.constant is not None and right.constant is not None:
            folded = ast.BinOp(ast.Constant(left.constant), operator, ast.Constant(right.constant))
            text = compile(ast.fix_missing_locations(ast.Expression(folded)), "constant", "eval")
            number = number_of(eval(text, {}))  # noqa: S307 - two numbers and an operator
            return literal(number)  # type: ignore[arg-type]
        both = joined(joined(left.type, right.type), INT)
        kind = type(operator)
        if kind in OF_INTEGERS and both not in INTEGERS:
            self.refuse(node, "an operator of whole numbers, on others")
        if kind is ast.Mult and both == INT:
            return Value(
                f"({left.text} * {right.text})",
                INT,
                real=f"({as_real(left)} * {as_real(right)})",
                wide=f"((int64_t){left.text} * {right.text})",
            )
        if kind in BINARY and both == REAL:
            return Value(f"({as_real(left)} {BINARY[kind]} {as_real(right)})", REAL)
        if kind in BINARY:
            return Value(f"({left.text} {BINARY[kind]} {right.text})", both)
        if kind is ast.Div:
            return Value(f"({as_real(left)} / {as_real(right)})", REAL)
        if kind is ast.Pow and both == REAL:
            return Value(f"vs_pow({as_real(left)}, {as_real(right)})", REAL)
        if kind is ast.Mod:
            return Value(f"vs_mod{SUFFIX[both]}({left.text}, {right.text})", both)
        if kind is ast.FloorDiv and both in INTEGERS:
            return Value(f"vs_floordiv{SUFFIX[both]}({left.text}, {right.text})", both)
        self.refuse(node, f"the operator {kind.__name__} on such numbers")
        raise AssertionError

    def on_boolop(self, node: ast.BoolOp) -> Value:
        """Translate ``and`` and ``or``."""
        stops_at = isinstance(node.op, ast.Or)
        texts: list[str] = []
        for k, operand in enumerate(node.values):
            waiting = len(self.pending)
            value = self.truth(operand)
            if k and len(self.pending) > waiting:
                self.refuse(operand, "a row that a function returns, after 'and' or 'or'")
            if value.constant is not None and bool(value.constant) == stops_at and not texts:
                return literal(stops_at)
            if value.constant is None or bool(value.constant) == stops_at:
                texts.append(value.text)
        if not texts:
            return literal(not stops_at)
        return Value(f"({(' || ' if stops_at else ' && ').join(texts)})", BOOL)

    def on_compare(self, node: ast.Compare) -> Value:
        """Translate a comparison, or several in a row of which those in the middle have no effects."""
        values = self.numbers(node, [node.left, *node.comparators])
        if any(type(operator) not in COMPARE for operator in node.ops):
            self.refuse(node, f"the comparison '{ast.unparse(node)[:60]}'")
        if len(node.ops) > 1 and not all(
            isinstance(n, ast.Name | ast.Constant) for n in node.comparators[:-1]
        ):
            self.refuse(node, f"the comparison '{ast.unparse(node)[:60]}' of more than names")
        if all(value.constant is not None for value in values):
            folded = ast.Compare(
                ast.Constant(values[0].constant),
                node.ops,
                [ast.Constant(value.constant) for value in values[1:]],
            )
            text = compile(ast.fix_missing_locations(ast.Expression(folded)), "constant", "eval")
            return literal(bool(eval(text, {})))  # noqa: S307 - numbers and operators
        pairs = zip(values, node.ops, values[1:], strict=False)
        parts = [
            f"({left.wide or left.text} {COMPARE[type(op)]} {right.wide or right.text})"
            for left, op, right in pairs
        ]
        return Value(parts[0] if len(parts) == 1 else f"({' && '.join(parts)})", BOOL)

    def on_ifexp(self, node: ast.IfExp) -> Value:
        """Translate a choice between two numbers."""
        test = self.truth(node.test)
        if test.constant is not None:
            return self.expression(node.body if test.constant else node.orelse)
        waiting = len(self.pending)
        first, second = self.number(node.body), self.number(node.orelse)
        if len(self.pending) > waiting:
            self.refuse(node, "a row that a function returns, in a choice")
        kind = joined(first.type, second.type)
        if kind == REAL:
            return Value(f"({test.text} ? {as_real(first)} : {as_real(second)})", REAL)
        return Value(f"({test.text} ? {first.text} : {second.text})", kind)
