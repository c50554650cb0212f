"""Translation of functions to C: their statements, and one C function for each set of argument types.

The method ``do_NODE`` translates statements of the class NODE of syntax trees. A ``Value`` is an expression in C with
its type (``c_types``). What cannot be translated is refused: ``refuse`` raises an ``InputError`` with file and line; an
assertion after it is only for the type checker.
"""

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
    OMITTED,
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
from vibroswarm.export.source import Source, plain, source_of, without_docstring


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
    changes: tuple[bool, ...]
    """For each parameter in Python, whether the function may change the row or array that it is."""
    takes: tuple[bool, ...]
    """For each parameter in Python, whether it is one in C: a function that is not public has those that it uses."""


class Program:
    """The functions of a program; each is translated when a function that is translated calls it."""

    def __init__(
        self,
        struct_of: Mapping[Any, Struct],
        row_names: Mapping[str, Struct],
        globals: Mapping[str, Value],
        replaced: Mapping[Callable[..., Any], Callable[..., Any]],
        template: str,
        instead: Mapping[str, Any],
        enums: Mapping[str, int] = MappingProxyType({}),
        public: Collection[str] = (),
    ) -> None:
        """Begin without functions.

        Args:
            struct_of: types of the classes that functions construct. row_names: types of rows by the name of their
                class in the template, for classes that only stand for a strategy's own. globals: constant rows and
                numbers, by name. replaced: functions that are not exported, and those exported in place of them.
            template: name of the template's module; names of its functions in C do not contain it. instead: values of
                open global names of the template. enums: constants that have a name in C, by that without its ``VS_``.
            public: names of the template's functions that are called from outside.
        """
        self.struct_of, self.row_names, self.globals = struct_of, row_names, globals
        self.replaced, self.template, self.instead, self.enums = replaced, template, instead, enums
        self.public = public
        # Functions in C by (Python function, types of its arguments). A function comes after the functions that it
        # calls; it is None while it is being translated.
        self.compiled: dict[Any, Compiled | None] = {}
        self.tuples: dict[str, CTuple] = {}  # types of several values that functions return, by name
        self.names: set[str] = set()  # names in C that are taken

    def source(self, function: Any) -> Source:
        """Return the source of a function; open names of the template have the strategy's values."""
        is_template = plain(function).__module__ == self.template
        return source_of(function, self.instead if is_template else None)

    def called_from(self, public: set[str]) -> list[Compiled]:
        """Return the functions with these names in C and those that they call, each after those that it calls."""
        needed: list[Compiled] = []
        words = set(public)
        for item in reversed(self.compiled.values()):
            if item is not None and item.name in words:  # None: none is any more
                needed.append(item)
                words.update(re.findall(r"\w+", item.text))
        return needed[::-1]

    def function(
        self,
        function: Any,
        given: list[Any],
        caller: Source | None = None,
        node: ast.AST | None = None,
    ) -> Compiled:
        """Return a function in C for arguments of given types; it is translated once for each set of types.

        Args:
            function: the Python function. given: types of the arguments. caller, node: where it is called, for errors.
        Raises:
            InputError: the function calls itself, or has a construct that cannot be translated.
        """
        source = self.source(function)
        source.refuse_arguments()
        types = []
        for argument, kind in zip(source.tree.args.args, given, strict=True):
            hint = ast.unparse(argument.annotation) if argument.annotation is not None else ""
            # Annotations may widen the type of a number: one function then serves several types.
            if hint == "float" and kind in (BOOL, *INTEGERS):
                kind = REAL
            types.append(INT if hint == "int" and kind == BOOL else kind)
        key = (plain(function), tuple(types))
        if key in self.compiled:
            found = self.compiled[key]
            if found is None:  # still being translated
                raise (caller or source).refusal(node, f"{source.function.__name__} calls itself")
            return found
        self.compiled[key] = None
        is_public = plain(function).__module__ == self.template and source.function.__name__ in self.public
        made = Function(self, source, tuple(types), self.name_for(source)).translated(is_public=is_public)
        del self.compiled[key]  # so that it is inserted last, after the functions that it calls
        self.compiled[key] = made
        return made

    def name_for(self, source: Source) -> str:
        """Return a unique name in C for a function, which ends in a number if the name without it is taken.

        It contains the name of the function's module, unless that is the template.
        """
        module = source.function.__module__
        prefix = "" if module == self.template else f"{module.rpartition('.')[2]}_"
        name = base = f"vs_{prefix}{source.function.__name__}"
        count = 1
        while name in self.names:
            count += 1
            name = f"{base}_{count}"
        self.names.add(name)
        return name


class Function(Calls):
    """Translates one function for given types of its arguments."""

    def __init__(self, program: Program, source: Source, given: tuple[Any, ...], name: str) -> None:
        """Begin with the types ``given`` for the parameters; ``name`` is the function's name in C."""
        self.program, self.source, self.given, self.name = program, source, given, name
        self.types = dict(zip(source.names, given, strict=True))
        self.returns: Any = None
        self.loops, self.pending = [], []
        self.written = set()

    def translated(self, *, is_public: bool) -> Compiled:
        """Return the function in C; parameters that it does not use are left out unless it is public.

        An assignment can widen a variable's type, as from ``int`` to ``float``, also for statements before it in a
        loop. So the body is translated again and again until no type changes. Types only widen, so this ends.
        """
        body = without_docstring(self.source.tree.body)
        while True:
            before = dict(self.types), self.returns
            # The text starts anew; depth is the indentation of the body's lines. The counters ``changes`` and
            # ``calls_with_rows`` are not reset, as only their increase within an expression matters, nor is
            # ``written``, which only grows.
            self.aliases, self.depth, self.held = {}, 1, 0
            self.lines: list[str] = []
            for statement in body:
                self.statement(statement)
            if (dict(self.types), self.returns) == before:
                break
        names = self.source.names
        body_text = "\n".join(self.lines)
        # Not behind a dot or arrow, where the name is that of a field.
        used = [re.search(rf"(?<![.>\w]){identifier(name)}\b", body_text) is not None for name in names]
        takes = tuple(is_public or is_used for is_used in used)
        texts = [
            parameter(kind, identifier(name), writes=name in self.written)
            for name, kind, is_taken in zip(names, self.given, takes, strict=True)
            if is_taken
        ]
        unused = [
            f"    (void){identifier(name)};"
            for name, is_used in zip(names, used, strict=True)
            if is_public and not is_used
        ]
        returns = self.returns or VOID
        head = f"{c_name(returns)} {self.name}({', '.join(texts) or 'void'})"
        # Variables of loops are declared in the heads of the loops.
        local = [
            f"    {declaration(kind, identifier(name))};"
            for name, kind in self.types.items()
            if name not in names and name not in self.program_loops
        ]
        place = f"/* {self.source.file}, line {self.source.before + self.source.tree.lineno} */"
        text = "\n".join([place, f"{head}", "{", *local, *unused, *self.lines, "}"])
        changes = tuple(name in self.written for name in names)
        return Compiled(self.name, self.given, returns, head, text, changes, takes)

    def write(self, text: str) -> None:
        """Append a line to the body, after the pending statements, which are thereby written too."""
        for line in (*self.pending, text):
            self.lines.append("    " * self.depth + line)
        self.pending.clear()

    def statement(self, node: ast.stmt) -> None:
        """Translate a statement, by the method for its class of syntax tree."""
        method: Any = getattr(self, f"do_{type(node).__name__.lower()}", None)
        if method is None:
            self.refuse(node, f"the statement '{ast.unparse(node).splitlines()[0][:60]}'")
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
        """Translate a call whose result is not used."""
        if not isinstance(node.value, ast.Call):
            self.refuse(node, f"the expression '{ast.unparse(node)[:60]}'")
        self.write(f"{self.expression(node.value).text};")

    def do_return(self, node: ast.Return) -> None:
        """Translate ``return`` of a number, a constant row or several numbers; the result's type may widen.

        All returns of a function must have results of one type, or numbers of which one type holds all. A ``return``
        without a value beside one with a value is refused; a body that may end without ``return`` is not. C returns
        copies, so an array or a row that can be changed is refused: a change of the copy would be lost.
        """
        if node.value is None:
            if self.returns not in (None, VOID):
                self.refuse(node, "a 'return' without a value, beside one with a value")
            self.returns = VOID
            self.write("return;")
            return
        if isinstance(node.value, ast.Tuple):
            values = [self.number(item) for item in node.value.elts]
            kind: Any = joined(self.returns, CTuple(tuple(value.type for value in values)))
            if kind is None:
                self.refuse(node, "another number of values than an earlier return")
            self.program.tuples[kind.name] = kind
            texts = [bare(as_type(*pair)) for pair in zip(values, kind.items, strict=True)]
            text = f"({kind.name}){{{', '.join(texts)}}}"
        else:
            value = self.expression(node.value)
            kind = joined(self.returns, value.type)
            if kind is None or is_by_reference(kind):
                self.refuse(node, f"returns '{ast.unparse(node.value)[:60]}'")
            text = bare(as_type(value, kind))
        self.returns = kind
        self.write(f"return {text};")

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
        if node.orelse:
            self.refuse(node, "'else' after a loop")
        test = self.truth(node.test)
        if self.pending:  # statements before the loop would be run only once
            self.refuse(node, "a row that a function returns, in the condition of a loop")
        self.write(f"while ({bare(test.text)}) {{")
        self.block(node.body)
        self.write("}")

    def do_for(self, node: ast.For) -> None:
        """Translate a ``for`` loop over ``range(...)`` or a tuple of constant whole numbers, as ``for k in (0, 2, 5)``.

        The numbers of a tuple become a constant array of ``vs_int``, so anything but constants of 32 bits is refused.
        The variable must not be an argument, nor be assigned in the body or elsewhere, because it is the counter of the
        loop in C and is declared there.
        """
        if node.orelse or not isinstance(node.target, ast.Name):
            self.refuse(node, f"the loop 'for {ast.unparse(node.target)}'")
        name = identifier(node.target.id)
        if any(
            isinstance(other, ast.Name) and isinstance(other.ctx, ast.Store) and other.id == node.target.id
            for statement in node.body
            for other in ast.walk(statement)
        ):
            self.refuse(node, f"the variable '{node.target.id}' of a loop is changed in it")
        if node.target.id in self.source.names:  # which has a type of its own
            self.refuse(node, f"the variable '{node.target.id}' of a loop is also an argument")
        if isinstance(node.iter, ast.Tuple):
            found = [self.number(item) for item in node.iter.elts]
            for item, value in zip(node.iter.elts, found, strict=True):
                if value.constant is None or value.type not in (BOOL, INT):
                    self.refuse(item, f"'{ast.unparse(item)[:60]}' in a loop is not a constant whole number")
            values = [value.text for value in found]
            # Write an array of the numbers, a loop over its indices, and the variable as the first line of the body.
            # That line is indented one level deeper, as ``block`` does for the other lines of the body.
            self.held += 1
            self.write(f"static const vs_int held_{self.held}[] = {{{', '.join(values)}}};")
            self.write(f"for (int k_{self.held} = 0; k_{self.held} < {len(values)}; k_{self.held}++) {{")
            self.lines.append(
                "    " * (self.depth + 1) + f"const vs_int {name} = held_{self.held}[k_{self.held}];"
            )
        else:
            self.write(self.head_of_range(node, name))
        self.types.setdefault(node.target.id, INT)  # unless it is known from the translation before
        self.loops.append(node.target.id)
        self.block(node.body)
        self.loops.pop()
        self.write("}")

    def head_of_range(self, node: ast.For, name: str) -> str:
        """Return the head of a loop over ``range``; the end is computed once, before the loop, as in Python.

        The step must be a positive constant.
        """
        call = node.iter
        if not (isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id == "range"):
            self.refuse(node, f"a loop over '{ast.unparse(node.iter)[:60]}'")
        values = [self.number(argument) for argument in call.args]
        if call.keywords or not 1 <= len(values) <= 3 or REAL in [value.type for value in values]:
            self.refuse(node, f"'{ast.unparse(call)[:60]}'")
        step = values[2].constant if len(values) == 3 else 1
        if step is None or step <= 0:
            self.refuse(node, f"the step of '{ast.unparse(call)[:60]}'")
        start = bare(values[0].text) if len(values) > 1 else "0"
        stop = values[1] if len(values) > 1 else values[0]
        # Anything but a constant is held, because the body may change what it depends on.
        end = stop.text if stop.constant is not None else self.hold(Value(stop.text, INT))
        return f"for ({INT} {name} = {start}; {name} < {end}; {name} += {step}) {{"

    def do_annassign(self, node: ast.AnnAssign) -> None:
        """Translate an assignment with an annotation, which is ignored: the value has a type of its own."""
        if node.value is None:
            self.refuse(node, "a variable without a value")
        self.assign(node.target, self.expression(node.value), node)

    def do_augassign(self, node: ast.AugAssign) -> None:
        """Translate ``x += y`` and the like as ``x = x + y``."""
        # ``x`` on the right must be an expression that is read, not assigned to, so the target is parsed again. Its
        # line is kept for errors.
        before = ast.parse(ast.unparse(node.target), mode="eval").body
        ast.increment_lineno(before, node.lineno - 1)
        left, right = self.numbers(node, [before, node.value])
        self.assign(node.target, self.arithmetic(node, node.op, left, right), node)

    def do_assign(self, node: ast.Assign) -> None:
        """Translate ``x = y``, ``x = y = z``, ``x, y = z, w`` and ``x, y = f()``."""
        if len(node.targets) > 1:
            value = self.number(node.value)
            if value.constant is None:  # computed once for all targets
                value = self.held_value(value)
            for target in node.targets:
                self.assign(target, value, node)
            return
        (target,) = node.targets
        if not isinstance(target, ast.Tuple):
            self.assign_expression(target, node.value, node)
        elif isinstance(node.value, ast.Tuple) and len(target.elts) == len(node.value.elts):
            self.assign_each(target.elts, node.value.elts, node)
        else:
            self.unpack(target, node)

    def assign_each(self, targets: list[ast.expr], values: list[ast.expr], node: ast.Assign) -> None:
        """Translate an assignment of several values, all of which Python computes before it assigns the first one.

        In C, each value is computed and assigned in turn. The result can differ only if a later value may read an
        earlier target. In this case all values are first stored in new C variables (``hold``), and then assigned.
        """
        if any(self.may_read(value, target) for k, target in enumerate(targets) for value in values[k + 1 :]):
            found = [self.expression(value) for value in values]
            # A number that is known when the program is translated cannot change. Of an array, or a row that can be
            # changed, only the name is assigned. So these need no variable.
            held = [
                value if value.constant is not None or is_by_reference(value.type) else self.held_value(value)
                for value in found
            ]
            for target, value in zip(targets, held, strict=True):
                self.assign(target, value, node)
            return
        for target, item in zip(targets, values, strict=True):
            self.assign_expression(target, item, node)

    def may_read(self, value: ast.expr, target: ast.expr) -> bool:
        """Return whether an expression may read the variable, field or element that an assignment changes.

        Two names may stand for one row or array, so types are compared instead of names. An expression may read a field
        if it reads the field of this name of any row of this type, or contains a row, other than to read a field of it,
        in which there is one: a function that is given the row may read it. It may read an element of an array if the
        same is true of the field that is the array. A variable for an array may stand for any array of its type.

        Args:
            target: what is assigned to.
        """
        if isinstance(target, ast.Name):
            return any(isinstance(node, ast.Name) and node.id == target.id for node in ast.walk(value))
        if isinstance(self.kind_of(target), Struct) and not isinstance(value, ast.Constant):
            return True  # a whole row is replaced, whose fields are not compared one by one
        place, array = target, None
        if isinstance(target, ast.Subscript):
            place, array = target.value, self.kind_of(target.value)
        row, name = None, ""  # the struct of the field, and its name; None if a variable stands for the array
        if isinstance(place, ast.Attribute):
            row, name = self.kind_of(place.value), place.attr
        # Rows and arrays of which only a field or element is read.
        of_parts = {
            id(node.value) for node in ast.walk(value) if isinstance(node, ast.Attribute | ast.Subscript)
        }
        for node in ast.walk(value):
            if not isinstance(node, ast.Name | ast.Attribute | ast.Subscript):
                continue
            kind = self.kind_of(node)
            if array is not None and kind == array and (row is None or isinstance(node, ast.Name)):
                return True
            if isinstance(node, ast.Attribute) and node.attr == name and self.kind_of(node.value) == row:
                return True
            if id(node) not in of_parts and contains(kind, row or array):
                return True
        return False

    def kind_of(self, node: ast.expr) -> Any:
        """Return the type of a variable, or of a field or element at any depth; None for any other expression."""
        if isinstance(node, ast.Name):
            return self.aliases[node.id].type if node.id in self.aliases else self.types.get(node.id)
        if isinstance(node, ast.Attribute):
            row = self.kind_of(node.value)
            return row.type_of(node.attr) if isinstance(row, Struct) else None
        if isinstance(node, ast.Subscript):
            array = self.kind_of(node.value)
            return array.element if isinstance(array, CArray) else None
        return None

    def held_value(self, value: Value) -> Value:
        """Return a new constant that is set to a value before the current statement; a product is held in 64 bits."""
        if not value.wide:
            return Value(self.hold(value), value.type)
        name = self.hold(Value(value.wide, LONG))
        return Value(f"((vs_int){name})", value.type, real=f"((vs_real){name})", wide=name)

    def assign_expression(self, target: ast.expr, item: ast.expr, node: ast.Assign) -> None:
        """Translate the assignment of an expression to one target.

        Python computes the value before the index of an element, as in ``s.counts[s.k] = f(s)``; C leaves the order
        open. So if the value may change a row, an index that may read one is refused.
        """
        before = self.changes
        value = self.expression(item)
        if self.changes > before and isinstance(target, ast.Subscript):
            index = target.slice
            if self.reads_row(index) or any(isinstance(part, ast.Call) for part in ast.walk(index)):
                self.refuse(node, "a call that may change a row beside an index that may read one")
        self.assign(target, value, node)

    def unpack(self, target: ast.Tuple, node: ast.Assign) -> None:
        """Assign the values that one call returns to several targets; ``_`` takes a value that is not used."""
        value = self.expression(node.value)
        if not isinstance(value.type, CTuple) or len(value.type.items) != len(target.elts):
            self.refuse(node, f"'{ast.unparse(node)[:60]}'")
        name = self.hold(value)
        for k, item in enumerate(target.elts):
            if not (isinstance(item, ast.Name) and item.id == "_"):
                self.assign(item, Value(f"{name}.v{k}", value.type.items[k]), node)

    def assign(self, target: ast.expr, value: Value, node: ast.AST) -> None:
        """Write the assignment of a value to a variable, a field or an element; refuse a value of an unfit type.

        Args:
            node: the statement, for errors.
        """
        if value.type == OMITTED:
            self.refuse(node, "a field that the robot's program does not have")
        if isinstance(target, ast.Name):
            self.assign_name(target.id, value, node)
            return
        if not isinstance(target, ast.Attribute | ast.Subscript):
            self.refuse(node, f"an assignment to '{ast.unparse(target)[:60]}'")
        before = self.changes
        place = self.expression(target)
        if self.changes > before:
            self.refuse(node, f"a call that may change a row, in the index of '{ast.unparse(target)[:60]}'")
        self.written.add(place.root)
        if joined(place.type, value.type) is None:
            self.refuse(node, f"'{ast.unparse(target)[:60]}' is given a value of another kind")
        if place.type in INTEGERS and value.type == REAL:
            self.refuse(node, f"'{ast.unparse(target)[:60]}', a whole number, is given a fraction")
        text = as_type(value, place.type)
        if (place.type, value.type) == (INT, LONG):  # the row holds 32 bits, in Python too
            text = f"((vs_int){text})"
        self.write(f"{place.text} = {f'VS_STORE({bare(text)})' if place.is_stored else bare(text)};")

    def assign_name(self, name: str, value: Value, node: ast.AST) -> None:
        """Write the assignment of a value to a variable, whose type may widen by it.

        If the value is an array or a row that can be changed, nothing is written: the variable becomes an alias, as in
        Python. It must then stand for the same row everywhere.
        """
        if name in self.program_loops:  # a variable of a loop is declared in the loop alone
            self.refuse(node, f"the variable '{name}' of a loop is also assigned outside of it")
        if is_by_reference(value.type):
            # Refuse an element of an array, because its index may change later; a second row for the same variable; and
            # a variable that holds a number elsewhere, before or (as the body is translated again) after this.
            if "[" in value.text or self.aliases.get(name, value).text != value.text or name in self.types:
                self.refuse(node, f"the name '{name}' for more than one row or array")
            self.aliases[name] = value
            return
        # The value is a number or a named tuple here; the parameter is a pointer in C, which stays the same.
        if name in self.source.names and isinstance(self.types[name], Struct | CArray):
            self.refuse(node, f"the argument '{name}' is given another row")
        kind = joined(self.types.get(name), value.type)
        if kind is None or (name in self.source.names and kind != self.types[name]):
            self.refuse(node, f"'{name}' is given values of several kinds")
        self.types[name] = kind
        self.write(f"{identifier(name)} = {bare(as_type(value, kind))};")


def contains(kind: Any, part: Any) -> bool:
    """Return whether a type is, or contains at any depth, a row or array of the type ``part``."""
    if kind == part:
        return True
    if isinstance(kind, CArray):
        return contains(kind.element, part)
    return isinstance(kind, Struct) and any(contains(item, part) for _, item in kind.fields)
