"""Translation of functions to C: their statements (``do_NODE``), and one C function for each set of argument types."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from vibroswarm.export.c_calls import Calls
from vibroswarm.export.c_types import (
    BOOL,
    INT,
    INTEGERS,
    LONG,
    REAL,
    VOID,
    CArray,
    CTuple,
    Struct,
    Value,
    as_type,
    bare,
    c_name,
    declaration,
    identifier,
    is_by_reference,
    joined,
    parameter,
)
from vibroswarm.export.source import Source, plain, source_of


@dataclass(frozen=True)
class Compiled:
    """A function translated to C."""

    name: str
    """Its name in C."""
    parameters: tuple[Any, ...]
    """Types of its parameters."""
    returns: Any
    """Type of its result."""
    head: str
    """Its first line, without the body."""
    text: str
    """The whole function."""
    place: str
    """File and line of its source."""
    changes: tuple[bool, ...]
    """For each parameter in Python, whether the function may change the row or array that it is."""
    takes: tuple[bool, ...]
    """For each parameter in Python, whether it is one in C: a function that is not public has those that it uses."""


class Program:
    """The functions of a program; each is translated when a function that is translated calls it."""

    def __init__(
        self,
        struct_of: Mapping[Any, Struct],
        globals: Mapping[str, Value],
        replaced: Mapping[Callable[..., Any], Callable[..., Any]],
        template: str,
        instead: Mapping[str, Any],
        enums: Mapping[str, int] = MappingProxyType({}),
        public: Collection[str] = (),
    ) -> None:
        self.struct_of, self.globals = struct_of, globals
        self.replaced, self.template, self.instead, self.enums = replaced, template, instead, enums
        self.public = public
        # Functions in C by (Python function, types of its arguments), each after the functions that it calls.
        self.compiled: dict[Any, Compiled] = {}
        self.tuples: dict[str, CTuple] = {}  # types of several values that functions return, by name

    def source(self, function: Any) -> Source:
        """Return the source of a function; open names of the template have the strategy's values."""
        is_template = plain(function).__module__ == self.template
        return source_of(function, self.instead if is_template else None)

    def called_from(self, public: set[str]) -> list[Compiled]:
        """Return the functions with these names in C and those that they call, each after those that it calls."""
        needed: list[Compiled] = []
        words = set(public)
        for item in reversed(self.compiled.values()):
            if item.name in words:
                needed.append(item)
                words.update(re.findall(r"\w+", item.text))
        return needed[::-1]

    def function(self, function: Any, given: list[Any]) -> Compiled:
        """Return a function in C for arguments of given types; it is translated once for each set of types."""
        source = self.source(function)
        arguments = source.tree.args
        special = (
            arguments.vararg,
            arguments.kwarg,
            *arguments.kwonlyargs,
            *arguments.defaults,
            *arguments.posonlyargs,
        )
        source.require(not any(special), source.tree)
        types = []
        for argument, kind in zip(arguments.args, given, strict=True):
            hint = ast.unparse(argument.annotation) if argument.annotation is not None else ""
            # Annotations may widen the type of a number: one function then serves several types.
            types.append(
                REAL
                if hint == "float" and kind in INTEGERS
                else INT
                if hint == "int" and kind == BOOL
                else kind
            )
        key = (plain(function), tuple(types))
        if key not in self.compiled:
            is_public = (
                plain(function).__module__ == self.template and source.function.__name__ in self.public
            )
            translator = Function(self, source, tuple(types))
            self.compiled[key] = translator.translated(self.name_for(source), is_public=is_public)
        return self.compiled[key]

    def name_for(self, source: Source) -> str:
        """Return a unique name in C for a function, which ends in a number if the name without it is taken."""
        module = source.function.__module__
        prefix = "" if module == self.template else f"{module.rpartition('.')[2]}_"
        name = base = f"vs_{prefix}{source.function.__name__}"
        count = 1
        while name in {item.name for item in self.compiled.values()}:
            count += 1
            name = f"{base}_{count}"
        return name


class Function(Calls):
    """Translates one function for given types of its arguments."""

    def __init__(self, program: Program, source: Source, given: tuple[Any, ...]) -> None:
        self.program, self.source, self.given = program, source, given
        self.types = dict(zip(source.names, given, strict=True))
        self.returns: Any = None
        self.loops: list[str] = []  # variables of the loops in which the current statement stands
        self.pending, self.written = [], set()

    def translated(self, name: str, *, is_public: bool) -> Compiled:
        """Return the function in C, translated again until no type widens; parameters not used are left out."""
        before: Any = None
        while before != (self.types, self.returns):
            before = dict(self.types), self.returns
            # The text starts anew; depth is the indentation of the body's lines. ``written`` only grows.
            self.depth, self.held = 1, 0
            self.lines: list[str] = []
            for statement in self.source.tree.body:
                self.statement(statement)
        names = self.source.names
        # Not behind a dot or arrow, where the name is that of a field.
        used = [
            re.search(rf"(?<![.>\w]){identifier(one)}\b", "\n".join(self.lines)) is not None for one in names
        ]
        takes = tuple(is_public or is_used for is_used in used)
        texts = [
            parameter(kind, identifier(one), writes=one in self.written)
            for one, kind, is_taken in zip(names, self.given, takes, strict=True)
            if is_taken
        ]
        unused = [
            f"    (void){identifier(one)};"
            for one, is_used in zip(names, used, strict=True)
            if is_public and not is_used
        ]
        returns = self.returns or VOID
        head = f"{c_name(returns)} {name}({', '.join(texts) or 'void'})"
        # Variables of loops are declared in the heads of the loops.
        loops = {ast.unparse(node.target) for node in ast.walk(self.source.tree) if isinstance(node, ast.For)}
        local = [
            f"    {declaration(kind, identifier(one))};"
            for one, kind in self.types.items()
            if one not in names and one not in loops
        ]
        text = "\n".join([head, "{", *local, *unused, *self.lines, "}"])
        place = f"{self.source.file}, line {self.source.before + self.source.tree.lineno}"
        changes = tuple(one in self.written for one in names)
        return Compiled(name, self.given, returns, head, text, place, changes, takes)

    def write(self, text: str) -> None:
        """Append a line to the body, after the pending statements, which are thereby written too."""
        self.lines += ["    " * self.depth + line for line in (*self.pending, text)]
        self.pending.clear()

    def statement(self, node: ast.stmt) -> None:
        """Translate a statement, by the method for its class of syntax tree."""
        method: Any = getattr(self, f"do_{type(node).__name__.lower()}", None)
        self.source.require(method is not None, node)
        is_element = isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Subscript)
        self.whole = None
        if isinstance(node, ast.Expr | ast.Return | ast.AnnAssign | ast.Assign) and not is_element:
            self.whole = node.value
        if isinstance(node, ast.If):
            self.whole = node.test
        method(node)

    def block(self, statements: list[ast.stmt]) -> None:
        """Translate the statements of a block, indented one level deeper."""
        self.depth += 1
        for statement in statements:
            self.statement(statement)
        self.depth -= 1

    def do_pass(self, node: ast.Pass) -> None:
        """Do nothing."""

    def do_break(self, node: ast.Break) -> None:
        """Leave a loop."""
        self.write("break;")

    def do_continue(self, node: ast.Continue) -> None:
        """Go on with a loop."""
        self.write("continue;")

    def do_expr(self, node: ast.Expr) -> None:
        """Translate a call whose result is not used, and leave out a docstring."""
        if not (isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)):
            self.write(f"{self.expression(node.value).text};")

    def do_return(self, node: ast.Return) -> None:
        """Translate ``return`` of a number, a constant row or several numbers; the result's type may widen."""
        if node.value is None:
            self.write("return;")
            return
        if isinstance(node.value, ast.Tuple):
            values = [self.expression(item) for item in node.value.elts]
            kind = CTuple(tuple(value.type for value in values))
            self.program.tuples[kind.name] = kind
            text = f"({kind.name}){{{', '.join(bare(value.text) for value in values)}}}"
            value = Value(text, kind)
        else:
            value = self.expression(node.value)
        self.returns = joined(self.returns, value.type)
        self.source.require(self.returns is not None and not is_by_reference(self.returns), node)
        self.write(f"return {bare(as_type(value, self.returns))};")

    def do_if(self, node: ast.If) -> None:
        """Translate ``if``; if the test is constant, only the statements that are run."""
        test = self.truth(node.test)
        if test.constant is not None:
            for statement in node.body if test.constant else node.orelse:
                self.statement(statement)
            return
        self.write(f"if ({bare(test.text)}) {{")
        self.block(node.body)
        if node.orelse:
            self.write("} else {")
            self.block(node.orelse)
        self.write("}")

    def do_while(self, node: ast.While) -> None:
        """Translate ``while``."""
        self.source.require(not node.orelse, node)
        self.write(f"while ({bare(self.truth(node.test).text)}) {{")
        self.block(node.body)
        self.write("}")

    def do_for(self, node: ast.For) -> None:
        """Translate a ``for`` loop over ``range(...)``, whose step is a positive constant."""
        call, name = node.iter, ast.unparse(node.target)
        is_range = isinstance(call, ast.Call) and ast.unparse(call.func) == "range" and not call.keywords
        self.source.require(is_range and not node.orelse and name not in self.source.names, node)
        values = [self.expression(argument) for argument in call.args]  # type: ignore[attr-defined]
        start, stop = values[:2] if len(values) > 1 else (Value("0", INT), values[0])
        step = values[2].constant if len(values) > 2 else 1
        self.source.require(step is not None and step > 0, node)
        # Anything but a constant is held, because the body may change what it depends on.
        end = stop.text if stop.constant is not None else self.hold(Value(stop.text, INT)).text
        counter = identifier(name)
        self.write(f"for ({INT} {counter} = {bare(start.text)}; {counter} < {end}; {counter} += {step}) {{")
        self.types.setdefault(name, INT)  # unless it is known from the translation before
        self.loops.append(name)
        self.block(node.body)
        self.loops.pop()
        self.write("}")

    def do_annassign(self, node: ast.AnnAssign) -> None:
        """Translate an assignment with an annotation, which is ignored: the value has a type of its own."""
        self.source.require(node.value is not None, node)
        self.assign(node.target, self.expression(node.value), node)  # type: ignore[arg-type]

    def do_augassign(self, node: ast.AugAssign) -> None:
        """Translate ``x += y`` and the like as ``x = x + y``."""
        # ``x`` on the right must be an expression that is read, not assigned to, so the target is parsed again. Its
        # line is kept for errors.
        before = ast.parse(ast.unparse(node.target), mode="eval").body
        ast.increment_lineno(before, node.lineno - 1)
        value = self.arithmetic(node, node.op, self.expression(before), self.expression(node.value))
        self.assign(node.target, value, node)

    def do_assign(self, node: ast.Assign) -> None:
        """Translate ``x = y``, ``x, y = z, w`` and ``x, y = f()``; ``_`` takes a value that is not used."""
        self.source.require(len(node.targets) == 1, node)
        (target,) = node.targets
        if not isinstance(target, ast.Tuple):
            self.assign(target, self.expression(node.value), node)
            return
        if isinstance(node.value, ast.Tuple):
            self.assign_each(target.elts, node.value.elts, node)
            return
        value = self.expression(node.value)
        self.source.require(isinstance(value.type, CTuple), node)
        name = self.hold(value).text
        for item, (member, kind) in zip(target.elts, value.type.fields, strict=True):
            if ast.unparse(item) != "_":
                self.assign(item, Value(f"{name}.{member}", kind), node)

    def assign_each(self, targets: list[ast.expr], values: list[ast.expr], node: ast.Assign) -> None:
        """Translate an assignment of several values, stored first if one may read an earlier target."""
        if any(self.may_read(value, target) for k, target in enumerate(targets) for value in values[k + 1 :]):
            held = []
            for item in values:
                self.whole = item
                value = self.expression(item)
                held.append(value if value.constant is not None else self.hold(value))
            for target, value in zip(targets, held, strict=True):
                self.assign(target, value, node)
            return
        for target, item in zip(targets, values, strict=True):
            self.whole = None if isinstance(target, ast.Subscript) else item
            self.assign(target, self.expression(item), node)

    def may_read(self, value: ast.expr, target: ast.expr) -> bool:
        """Return whether an expression may read the variable, field or element that an assignment changes."""
        parts = list(ast.walk(value))
        if isinstance(target, ast.Subscript):
            return any(isinstance(part, ast.Subscript | ast.Call) for part in parts)
        names = {getattr(part, "id", None) or getattr(part, "attr", None) for part in parts}
        if not isinstance(target, ast.Attribute):
            return ast.unparse(target) in names
        row = self.expression(target.value).type
        given = [item for part in parts if isinstance(part, ast.Call) for item in part.args]
        return target.attr in names or any(
            contains(self.expression(item).type, row)
            for item in given
            if isinstance(item, ast.Name | ast.Attribute)
        )

    def assign(self, target: ast.expr, value: Value, node: ast.AST) -> None:
        """Write an assignment; a changeable row gets no second name, as a copy would be changed in its place."""
        if isinstance(target, ast.Name):
            name, kind = target.id, joined(self.types.get(target.id), value.type)
            is_kept = name not in self.source.names or kind == self.types[name]
            self.source.require(kind is not None and is_kept and name not in self.loops, node)
            self.source.require(not is_by_reference(kind), node)
            self.types[name] = kind
            self.write(f"{identifier(name)} = {bare(as_type(value, kind))};")
            return
        place = self.expression(target)
        self.written.add(place.root)
        text = as_type(value, place.type)
        if (place.type, value.type) == (INT, LONG):  # the row holds 32 bits, in Python too
            text = f"((vs_int){text})"
        self.write(f"{place.text} = {f'VS_STORE({bare(text)})' if place.is_stored else bare(text)};")


def contains(kind: Any, part: Any) -> bool:
    """Return whether a type is, or contains at any depth, a row of the type ``part``."""
    inner = [kind.element] if isinstance(kind, CArray) else [item for _, item in getattr(kind, "fields", ())]
    return kind == part or any(contains(item, part) for item in inner)
