"""Translation of expressions to C.

A ``Value`` is an expression in C with its type, and its number if it is constant (``c_types``). Types follow from those
of the function's arguments, as in Numba: ``int`` becomes ``vs_int`` (32 bits), ``float`` becomes ``vs_real`` (float or
double). The method ``on_NODE`` translates syntax trees of the class NODE. What cannot be translated is refused:
``refuse`` raises an ``InputError`` with file and line; an assertion after it is only for the type checker.
"""

from __future__ import annotations

import ast
import math
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final, NoReturn

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
    field_of,
    identifier,
    is_by_reference,
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
OF_INTEGERS: Final = (ast.BitAnd, ast.BitOr, ast.BitXor, ast.LShift, ast.RShift)
"""Operators that take whole numbers only."""
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
    aliases: dict[str, Value]
    """Rows and arrays to which local variables refer, by the variable's name."""
    loops: list[str]
    """Variables of the loops in which the current statement stands."""
    pending: list[str]
    """Statements in C to write before the current one."""
    changes: int = 0
    """Number of calls translated so far that may change a row."""
    calls_with_rows: int = 0
    """Number of calls translated so far that are given a row or array which may change: they may read it."""
    written: set[str]
    """Names of the parameters whose rows or arrays the function may change."""

    def refuse(self, node: ast.AST, why: str) -> NoReturn:
        """Raise the error that refuses a construct, with its line; ``why`` says what is refused."""
        raise self.source.refusal(node, why)

    def expression(self, node: ast.expr) -> Value:
        """Return the translation of an expression, by the method for its class of syntax tree."""
        method: Any = getattr(self, f"on_{type(node).__name__.lower()}", None)
        if method is None:
            self.refuse(node, f"{type(node).__name__} '{ast.unparse(node)[:60]}'")
        found: Value = method(node)
        return found

    def number(self, node: ast.expr) -> Value:
        """Return the translation of an expression that must be a number or a truth value; refuse any other."""
        return self.numbers(node, [node])[0]

    def in_any_order(self, node: ast.AST, items: list[ast.expr]) -> list[Value]:
        """Return the translations of expressions that C may compute in any order, such as arguments of a call.

        The order must not matter: if one expression may change a row, the others must neither change nor read one;
        otherwise they are refused.
        """
        found, changing, called = [], set[int](), set[int]()
        for k, item in enumerate(items):
            before = self.changes, self.calls_with_rows
            found.append(self.expression(item))
            if self.changes > before[0]:
                changing.add(k)
            elif self.calls_with_rows > before[1]:
                called.add(k)
        if len(changing) > 1:
            self.refuse(node, "two calls that may change a row in one expression, whose order C leaves open")
        if changing and called:
            self.refuse(
                node,
                "a call that may change a row beside one that may read it, in an order that C leaves open",
            )
        if changing and any(self.reads_row(item) for k, item in enumerate(items) if k not in changing):
            self.refuse(node, "a call that may change a row beside a field, in an order that C leaves open")
        return found

    def reads_row(self, item: ast.expr) -> bool:
        """Return whether an expression reads a number in a row or array that a call might change.

        ``size`` of an array does not count, because it cannot change; an element of ``shape`` counts, although it
        cannot change either. A row or array that is passed to a function is not read here, but there
        (``calls_with_rows``).
        """
        for part in ast.walk(item):
            # For a field or element such as ``s.counts[k]``, find the variable at its beginning: ``s``.
            root: ast.AST = part
            while isinstance(root, ast.Attribute | ast.Subscript):
                root = root.value
            if root is part or not isinstance(root, ast.Name) or not isinstance(part, ast.expr):
                continue  # not a field or element of a variable
            kind = self.types.get(root.id)
            # A call might change an array, a row that can be changed, and what a local variable refers to.
            might_change = is_by_reference(kind) or root.id in self.aliases
            is_size = isinstance(part, ast.Attribute) and part.attr in ("size", "shape")
            if is_size or not might_change:
                continue
            if not isinstance(self.expression(part).type, Struct | CArray):  # a number
                return True
        return False

    def numbers(self, node: ast.AST, items: list[ast.expr]) -> list[Value]:
        """Return the translations of expressions that must be numbers, and that C may compute in any order."""
        values = self.in_any_order(node, items)
        for item, value in zip(items, values, strict=True):
            if value.type not in (INT, LONG, REAL, BOOL):
                self.refuse(item, f"'{ast.unparse(item)[:60]}' is not a number")
        return values

    def truth(self, node: ast.expr) -> Value:
        """Return the translation of an expression that must be a truth value; refuse any other."""
        value = self.expression(node)
        if value.type != BOOL:
            self.refuse(node, f"'{ast.unparse(node)[:60]}' is not a comparison")
        return value

    def on_constant(self, node: ast.Constant) -> Value:
        """Translate a number or truth value; refuse any other constant."""
        number = number_of(node.value)
        if number is None:
            self.refuse(node, f"the constant {node.value!r}")
        return literal(number)

    def on_name(self, node: ast.Name) -> Value:
        """Translate the name of a variable, a constant row or a global number.

        A variable of a loop is refused after the loop: in C it ends with the loop. A row that is a parameter is a
        pointer in C.
        """
        name = node.id
        if name in self.aliases:
            return self.aliases[name]
        if name in self.types:
            kind = self.types[name]
            if name in self.program_loops and name not in self.loops:
                self.refuse(node, f"the variable '{name}' of a loop is read after it")
            if isinstance(kind, Struct) and name in self.source.names:
                return Value(f"(*{identifier(name)})", kind, is_place=True, root=name)
            root = name if name in self.source.names else ""
            return Value(identifier(name), kind, is_place=isinstance(kind, Struct), root=root)
        if name in self.program.globals:
            return self.program.globals[name]
        if name in self.source.space:
            number = number_of(self.source.space[name])
            if number is not None and self.program.enums.get(name) == number:
                return Value(f"VS_{name}", INT, number)
            if number is not None:
                return literal(number)
        self.refuse(node, f"the name '{name}', which is not a number, variable or row")

    @cached_property
    def program_loops(self) -> set[str]:
        """Names of the variables of all ``for`` loops in the function."""
        return {
            node.target.id
            for node in ast.walk(self.source.tree)
            if isinstance(node, ast.For) and isinstance(node.target, ast.Name)
        }

    def on_attribute(self, node: ast.Attribute) -> Value:
        """Translate a field of a row, the size of an array, or a constant of ``math``.

        A field that the program leaves out has the type ``OMITTED``, and can only be passed to a constructor.
        """
        name = math_name(self.source, node)
        if name is not None:
            number = number_of(getattr(math, name, None))
            if number is None:
                self.refuse(node, f"math.{name}")
            return literal(number)
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
        # A short integer would be ``vs_int`` in expressions, like one in an array; no struct has such a field.
        number_kind = kind if isinstance(kind, Struct | CArray) or kind in (REAL, BOOL, LONG) else INT
        return Value(field_of(row.text, node.attr), number_kind, is_place=True, root=row.root)

    def on_subscript(self, node: ast.Subscript) -> Value:
        """Translate an element of an array, or a length such as ``a.shape[0]``, which is a constant.

        Constant indices are checked against the length, others are not: a negative index would count from the end in
        Python, but not in C. ``VS_LOAD`` converts stored floating-point numbers to ``vs_real`` where they are read. The
        target of an assignment is the element itself, for which ``VS_STORE`` converts the value.
        """
        if isinstance(node.value, ast.Attribute) and node.value.attr == "shape":
            array, axis = self.expression(node.value.value), self.expression(node.slice).constant
            if not isinstance(array.type, CArray) or axis is None:
                self.refuse(node, f"'{ast.unparse(node)}'")
            return literal(array.type.shape[int(axis)])
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
            text += f"[{bare(value.text)}]"
        is_stored, is_read = array.type.element == STORED, isinstance(node.ctx, ast.Load)
        if is_stored and is_read:
            text = f"VS_LOAD({text})"
        # ``is_place`` matters only for an element that is a row, which is passed by address and never converted.
        is_target = is_stored and not is_read
        return Value(text, array.type.number, is_place=True, is_stored=is_target, root=array.root)

    def on_unaryop(self, node: ast.UnaryOp) -> Value:
        """Translate ``-x`` or ``not x``; refuse any other operator of one operand."""
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
        # A product that may need more than 32 bits does so also with the other sign. A difference from 0 is never -0.0,
        # which a whole number cannot be.
        real, wide = (f"(0 - {text})" if text else "" for text in (value.real, value.wide))
        return Value(f"(-{value.text})", joined(value.type, INT), real=real, wide=wide)

    def on_binop(self, node: ast.BinOp) -> Value:
        """Translate an operator of two numbers."""
        left, right = self.numbers(node, [node.left, node.right])
        return self.arithmetic(node, node.op, left, right)

    def arithmetic(self, node: ast.AST, operator: ast.operator, left: Value, right: Value) -> Value:
        """Return the result of an operator, with Python's meaning of division and remainder.

        If both operands are constants, the result is computed here, as a constant. A product of 32-bit numbers has two
        further texts, in 64 bits and as a floating-point number, for uses where 32 bits might overflow.

        Args:
            node: the expression or statement, for errors.
        """
        if left.constant is not None and right.constant is not None:
            folded = ast.BinOp(ast.Constant(left.constant), operator, ast.Constant(right.constant))
            try:
                number = number_of(computed(folded))
            except (ArithmeticError, TypeError, ValueError) as error:  # a division by zero, or an overflow
                self.refuse(node, f"constants without a result ({error})")
            if number is None:  # such as (-8.0) ** 0.5, which is complex
                self.refuse(node, "constants whose result is not a number")
            return literal(number)
        both = joined(joined(left.type, right.type), INT)  # truth values count as whole numbers
        kind = type(operator)
        if kind in OF_INTEGERS and both not in INTEGERS:
            self.refuse(node, "an operator of whole numbers, on others")
        if kind is ast.Mult and both == INT:
            return Value(
                f"({left.text} * {right.text})",
                INT,
                real=f"({as_real(left)} * {as_real(right)})",
                wide=f"({left.wide or f'(int64_t){left.text}'} * {as_type(right, LONG)})",
            )
        if both in INTEGERS and (left.wide or (right.wide and kind in BINARY)) and kind is not ast.Div:
            return self.of_products(kind, left, right, both)
        if kind in BINARY and both == REAL:
            return Value(f"({as_real(left)} {BINARY[kind]} {as_real(right)})", REAL)
        if kind in BINARY:
            return Value(f"({left.text} {BINARY[kind]} {right.text})", both)
        if kind is ast.Div:
            return Value(f"({as_real(left)} / {as_real(right)})", REAL)
        if kind is ast.Pow and both == REAL and right.type in INTEGERS:
            return Value(f"vs_power({bare(left.text)}, {bare(as_type(right, LONG))})", REAL)
        if kind is ast.Pow and both == REAL:
            return Value(f"vs_pow({bare(as_real(left))}, {bare(as_real(right))})", REAL)
        # The operators of C for remainder and whole division round towards 0; the runtime's functions round down, as
        # Python.
        if kind is ast.Mod and both == REAL:
            return Value(f"vs_mod({bare(as_real(left))}, {bare(as_real(right))})", REAL)
        if kind is ast.Mod:
            return Value(f"vs_mod{SUFFIX[both]}({bare(left.text)}, {bare(right.text)})", both)
        if kind is ast.FloorDiv and both in INTEGERS:
            return Value(f"vs_floordiv{SUFFIX[both]}({bare(left.text)}, {bare(right.text)})", both)
        if kind is ast.Pow:
            self.refuse(node, "a power of whole numbers (write x * x, or x ** 2.0)")
        self.refuse(node, f"the operator {kind.__name__} on such numbers")

    def of_products(self, kind: type[ast.operator], left: Value, right: Value, both: str) -> Value:
        """Return the result of an operator of whole numbers one of which might overflow 32 bits, in 64 bits.

        A sum or difference also has a text of 32 bits, for uses where it is short, as an index.
        """
        texts = [as_type(value, LONG) for value in (left, right)]
        if kind in BINARY:
            wide = f"({texts[0]} {BINARY[kind]} {texts[1]})"
        else:
            name = "vs_mod_l" if kind is ast.Mod else "vs_floordiv_l"
            wide = f"{name}({', '.join(map(bare, texts))})"
        if both == LONG:
            return Value(wide, LONG)
        found = widened(wide)
        if kind in (ast.Add, ast.Sub):
            return replace(found, text=f"({left.text} {BINARY[kind]} {right.text})")
        return found

    def on_boolop(self, node: ast.BoolOp) -> Value:
        """Translate ``and`` and ``or``; operands that are constant and do not decide the result are left out."""
        stops_at = isinstance(node.op, ast.Or)
        texts: list[str] = []
        for k, operand in enumerate(node.values):
            waiting = len(self.pending)
            value = self.truth(operand)
            # A pending statement is written before the whole expression, so it would be run even where Python does not
            # evaluate the operand. The first operand (k = 0) is always evaluated.
            if k and len(self.pending) > waiting:
                self.refuse(operand, "a row that a function returns, after 'and' or 'or'")
            # A constant that decides the result is the result, unless operands before it must still be evaluated.
            if value.constant is not None and bool(value.constant) == stops_at and not texts:
                return literal(stops_at)
            if value.constant is None or bool(value.constant) == stops_at:
                texts.append(value.text)
        if not texts:
            return literal(not stops_at)
        if len(texts) == 1:
            return Value(texts[0], BOOL)
        return Value(f"({(' || ' if stops_at else ' && ').join(texts)})", BOOL)

    def on_compare(self, node: ast.Compare) -> Value:
        """Translate a comparison, or a chain such as ``a < b < c``.

        A chain becomes several comparisons, so its middle operands are written twice: they must be names or constants.
        """
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
            return literal(bool(computed(folded)))
        pairs = zip(values, node.ops, values[1:], strict=False)
        parts = [compared(left, COMPARE[type(op)], right) for left, op, right in pairs]
        return Value(parts[0] if len(parts) == 1 else f"({' && '.join(parts)})", BOOL)

    def on_ifexp(self, node: ast.IfExp) -> Value:
        """Translate ``a if test else b`` for two numbers; if the test is constant, only the value chosen."""
        test = self.truth(node.test)
        if test.constant is not None:
            return self.expression(node.body if test.constant else node.orelse)
        waiting = len(self.pending)
        first, second = self.number(node.body), self.number(node.orelse)
        # A pending statement is written before the whole expression, so it would be run whichever value is chosen.
        if len(self.pending) > waiting:
            self.refuse(node, "a row that a function returns, in a choice")
        kind = joined(first.type, second.type)
        if kind == INT and (first.wide or second.wide):
            return widened(f"({test.text} ? {as_type(first, LONG)} : {as_type(second, LONG)})")
        return Value(f"({test.text} ? {as_type(first, kind)} : {as_type(second, kind)})", kind)


def computed(folded: ast.expr) -> Any:
    """Return the value of an expression of numbers and operators."""
    text = compile(ast.fix_missing_locations(ast.Expression(folded)), "constant", "eval")
    return eval(text, {})  # noqa: S307 - numbers and operators only


def compared(left: Value, operator: str, right: Value) -> str:
    """Return a comparison of two numbers: as floating-point numbers if one of them is."""
    if joined(left.type, right.type) == REAL:
        return f"({as_real(left)} {operator} {as_real(right)})"
    # Products are compared in 64 bits, where 32 bits might overflow.
    return f"({as_type(left, LONG)} {operator} {as_type(right, LONG)})"
