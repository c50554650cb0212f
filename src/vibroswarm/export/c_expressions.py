"""Expressions of the robot's program in C. What is not known here is refused with its file and line.

Types follow from the arguments, as Numba's do: ``int`` is 64 bits wide, ``float`` is ``vs_real`` (float or double).
"""

from __future__ import annotations

import ast
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from vibroswarm.core.rng import uniform
from vibroswarm.export.c_types import BOOL, INT, INTEGERS, LONG, REAL, STORED, CArray, CTuple, Struct, joined
from vibroswarm.export.source import MATH, Number, Source, is_function, math_name, number_of, plain

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
OMITTED: Final = "omitted"
SUFFIX: Final = {REAL: "", INT: "_i", LONG: "_l"}
"""Of functions of the runtime, by the type of their arguments."""
KEYWORDS: Final = frozenset(
    (
        "auto", "break", "case", "char", "const", "continue", "default", "do", "double", "else", "enum", "extern",
        "float", "for", "goto", "if", "inline", "int", "long", "register", "restrict", "return", "short", "signed",
        "sizeof", "static", "struct", "switch", "typedef", "union", "unsigned", "void", "volatile", "while", "bool",
        "true", "false", "I",
    )
)  # fmt: skip


@dataclass(frozen=True)
class Value:
    """An expression in C.

    Args:
        constant: its number, if it is known. is_place: it names a place in memory. real, wide: the same as a
            floating-point number and in 64 bits, where whole numbers of 32 bits might overflow.
    """

    text: str
    type: Any
    constant: Number | None = None
    is_place: bool = False
    real: str = ""
    wide: str = ""


def literal(number: Number) -> Value:
    """Return a number in C."""
    if isinstance(number, bool):
        return Value("true" if number else "false", BOOL, number)
    if isinstance(number, int):
        is_small = abs(number) < 2**31
        text = str(number) if is_small else f"INT64_C({number})"
        return Value(f"({text})" if number < 0 else text, INT if is_small else LONG, number)
    if math.isnan(number):
        return Value("VS_NAN", REAL, number)
    if math.isinf(number):
        return Value("VS_INFINITY" if number > 0 else "(-VS_INFINITY)", REAL, number)
    return Value(f"VS_R({number!r})", REAL, number)


def identifier(name: str) -> str:
    """Return a Python name as a C name."""
    return f"{name}_" if name in KEYWORDS else name


def address(value: Value) -> str:
    """Return the address of a row."""
    inner = value.text.removeprefix("(*").removesuffix(")")
    return inner if value.text == f"(*{inner})" and inner.isidentifier() else f"&{value.text}"


def field_of(text: str, name: str) -> str:
    """Return the text of a row's field."""
    inner = text.removeprefix("(*").removesuffix(")")
    if text == f"(*{inner})" and inner.isidentifier():
        return f"{inner}->{identifier(name)}"
    return f"{text}.{identifier(name)}"


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
        """Return expressions that C may compute in any order: only one of them may change a row."""
        found, changing = [], 0
        for item in items:
            before = self.changes
            found.append(self.expression(item))
            changing += self.changes > before
        if changing > 1:
            self.refuse(node, "two calls that may change a row in one expression, whose order C leaves open")
        return found

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

    def on_call(self, node: ast.Call) -> Value:
        """Translate a call."""
        name = math_name(self.source, node.func)
        if name is not None:
            return self.call_of_math(node, name)
        if not isinstance(node.func, ast.Name) or node.func.id in self.types:
            self.refuse(node, f"the call '{ast.unparse(node)[:60]}'")
        assert isinstance(node.func, ast.Name)
        called = self.source.space.get(node.func.id)
        if called is None and node.func.id in BUILT_IN:
            return self.call_of_built_in(node, node.func.id)
        called = self.program.replaced.get(plain(called), called)
        if plain(called) is plain(uniform):
            return self.call_of_uniform(node)
        struct = self.program.struct_of.get(called)
        if struct is None and node.func.id in self.program.row_names:
            struct = self.program.row_names[node.func.id]
        if struct is not None:
            return self.construct(node, struct)
        if is_function(called):
            return self.call_of_function(node, called)
        self.refuse(node, f"the call of '{node.func.id}'")
        raise AssertionError

    def arguments(self, node: ast.Call, count: int) -> list[Value]:
        """Return the arguments of a call with ``count`` numbers."""
        if node.keywords or len(node.args) != count:
            self.refuse(node, f"the arguments of '{ast.unparse(node)[:60]}'")
        return self.numbers(node, node.args)

    def call_of_math(self, node: ast.Call, name: str) -> Value:
        """Translate a function of ``math``."""
        if name not in MATH:
            self.refuse(node, f"math.{name}")
        values = self.arguments(node, MATH[name])
        texts = ", ".join(as_real(value) for value in values)
        if name in ("degrees", "radians"):
            factor = 180.0 / math.pi if name == "degrees" else math.pi / 180.0
            return Value(f"({texts} * {literal(factor).text})", REAL)
        if name in ("floor", "ceil"):
            return Value(f"((int64_t)vs_{name}({texts}))", LONG, real=f"vs_{name}({texts})")
        if name == "sqrt" and values[0].constant is not None:
            return literal(math.sqrt(values[0].constant))
        return Value(f"vs_{name}({texts})", BOOL if name == "isnan" else REAL)

    def call_of_built_in(self, node: ast.Call, name: str) -> Value:
        """Translate ``abs``, ``min``, ``max``, ``int``, ``float``, ``bool`` or ``round``."""
        if name in ("min", "max"):
            values = self.arguments(node, max(len(node.args), 2))
            found = values[0]
            for value in values[1:]:
                kind = joined(joined(found.type, value.type), INT)
                texts = (as_real(item) if kind == REAL else item.text for item in (found, value))
                found = Value(f"vs_{name}{SUFFIX[kind]}({', '.join(texts)})", kind)
            return found
        (value,) = self.arguments(node, 1)
        if name == "abs":
            kind = joined(value.type, INT)
            return Value(f"vs_abs{SUFFIX[kind]}({value.text})", kind)
        if name == "bool" and value.type != BOOL:
            self.refuse(node, "bool() of a number")
        if name in ("bool", "float"):
            return value if value.type == BUILT_IN[name] else Value(as_real(value), REAL)
        if value.type != REAL:
            return Value(value.text, joined(value.type, INT), value.constant)
        return Value(f"((vs_int){'vs_round' if name == 'round' else ''}({value.text}))", INT)

    def call_of_uniform(self, node: ast.Call) -> Value:
        """Translate a uniform number."""
        texts = [value.text for value in self.arguments(node, 6)]
        return Value(f"vs_uniform({', '.join(texts)})", REAL)

    def construct(self, node: ast.Call, struct: Struct) -> Value:
        """Translate a new row: all zeros, or with all its fields given in order."""
        if not node.args and not node.keywords:
            return Value(f"({struct.name}){{0}}", struct)
        names = list(struct.source._fields)
        if node.keywords or len(node.args) != len(names):
            self.refuse(node, f"'{ast.unparse(node)[:60]}': not all fields, in order")
        texts = []
        for name, argument in zip(names, node.args, strict=True):
            value = self.expression(argument)
            if name in struct.omitted:
                continue
            texts.append(f".{identifier(name)} = {value.text}")
        return Value(f"({struct.name}){{{', '.join(texts)}}}", struct)

    def call_of_function(self, node: ast.Call, called: Any) -> Value:
        """Translate the call of a function of the program."""
        names = [argument.arg for argument in self.program.source(called).tree.args.args]
        given: dict[str, ast.expr] = dict(zip(names, node.args, strict=False))
        given |= {word.arg: word.value for word in node.keywords if word.arg}
        if len(node.args) > len(names) or set(given) != set(names):
            self.refuse(node, f"the arguments of '{ast.unparse(node)[:60]}'")
        values = self.in_any_order(node, [given[name] for name in names])
        compiled = self.program.function(called, [value.type for value in values], self.source, node)
        if compiled.changes:
            self.changes += 1
            self.writes = True
        texts = []
        for value, kind in zip(values, compiled.parameters, strict=True):
            if isinstance(kind, Struct):
                place = value
                if not value.is_place:
                    place = Value(self.hold(value), kind, is_place=True)
                texts.append(address(place))
            else:
                texts.append(as_real(value) if kind == REAL else value.text)
        return Value(f"{compiled.name}({', '.join(texts)})", compiled.returns)

    def hold(self, value: Value) -> str:
        """Keep a value in a variable of its own, before the statement under way; return its name."""
        self.held += 1
        name = f"held_{self.held}"
        kind = value.type.name if isinstance(value.type, Struct | CTuple) else value.type
        self.pending.append(f"const {kind} {name} = {value.text};")
        return name

    held: int = 0
    changes: int = 0
    """Calls so far that may change a row."""
    writes: bool = False
    """Whether the function may change a row."""


BUILT_IN: Final[dict[str, Any]] = {
    "abs": None, "min": None, "max": None, "int": INT, "float": REAL, "bool": BOOL, "round": INT,
}  # fmt: skip


def as_real(value: Value) -> str:
    """Return a number as a floating-point one."""
    if value.type == REAL or value.real:
        return value.real or value.text
    if value.constant is not None:
        return literal(float(value.constant)).text
    return f"((vs_real){value.text})"
