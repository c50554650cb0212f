"""Static analysis of the hooks of strategies and networks: errors, and what a robot knows of its task.

A hook is a function that the simulator calls, such as ``on_sample``; its arguments are listed in ``PARAMETERS`` and
explained in ``base``. Errors are found before the hooks are compiled. Numba would refuse most of them too, but with
messages about types. Messages here name the file and the line. Hooks of this package are checked by its tests, not at
every start (``is_shipped``).

A robot counts as told everything that its hooks read: fields of ``World``, and the places of readings. These are found
by reading the source of the hooks and of all functions that they call, so no author of a strategy can forget to state
one. A row that is used in a way that this analysis does not follow counts as read in whole, and a function whose source
cannot be read as reading all fields whose names are in its code.
"""

from __future__ import annotations

import ast
import inspect
import linecache
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from functools import cache, lru_cache
from itertools import chain
from types import FunctionType
from typing import TYPE_CHECKING, Any, Final

from vibroswarm.core.user_code import TEXT, is_known
from vibroswarm.errors import InputError, nearest, shown

if TYPE_CHECKING:
    from vibroswarm.strategies.base import Strategy

STRATEGY_HOOKS: Final[dict[str, tuple[str, ...]]] = {
    "begin": ("s", "a", "d", "p", "w"),
    "on_counts": ("s", "ones", "zeros", "p", "w"),
    "on_message": ("s", "a", "m", "sender", "t_s", "d", "p", "w"),
    "on_sample": ("s", "a", "x", "out", "d", "p", "w"),
    "on_timer": ("s", "a", "t_s", "out", "d", "p", "w"),
    "decision": ("s", "a", "p", "w"),
    "belief": ("s", "a", "p", "w"),
    "steer": ("s", "a", "x", "d", "p", "w"),
    "opposite": ("m",),
}
"""Arguments of the hooks of strategies, by name of the hook; ``base`` explains them."""
NETWORK_HOOKS: Final[dict[str, tuple[str, ...]]] = {
    "lost": ("sender", "receiver", "d", "p", "w"),
    "send": (
        "n",
        "a",
        "sender",
        "tick",
        "number",
        "bytes_on_air",
        "x_m",
        "y_m",
        "arrival_tick",
        "d",
        "p",
        "w",
    ),
}
"""Arguments of the hooks of networks, by name of the hook; ``networks.base`` explains them."""
PARAMETERS: Final = STRATEGY_HOOKS | NETWORK_HOOKS
"""Arguments of each hook. Their number and order are checked; a hook may give them names that none of them has here."""
ANSWERS: Final = {
    "decision": "0, 1 or -1 (undecided)", "belief": "a probability, or math.nan", "lost": "True or False",
    "on_sample": "True or False", "on_timer": "True or False",
}  # fmt: skip
"""What hooks return whose result is used, in words."""
UNUSED: Final = "unused"
"""The field of a row that has no fields."""
READ_ONLY: Final = ("m", "x", "p", "w")
"""Arguments that a hook must not change; other robots and calls are given the same. (``opposite`` changes its own.)"""
CHANCE: Final = ("random", "secrets", "uuid")
"""Modules whose random numbers a seed of the simulation does not determine."""


def where(function: Callable[..., Any], line: int | None = None) -> str:
    """Return where a function, or one of its lines, stands: ``voter.py, line 12, in on_sample``."""
    code = function.__code__
    return f"{code.co_filename}, line {line or code.co_firstlineno}, in {function.__name__}"


def check_function(
    name: str,
    function: Callable[..., Any],
    fields: Mapping[str, tuple[str, ...]],
    lists: Collection[str] = (),
) -> None:
    """Refuse a hook that has errors, or that calls a function of its file with errors.

    Args:
        name: of the hook, such as "on_sample". fields: names of the fields of each argument that is a row, by the
            argument's name in ``PARAMETERS``, such as ``s``. lists: names of the arrays of ``a`` that are parameters.
    Raises:
        InputError: it is no plain function, the number or the order of arguments is wrong, it uses a field that a row
            has not, has no number to return and has to, or the hook or a function that it calls changes a row that it
            may only read or a variable outside of itself, or draws random numbers that the seed does not determine.
    """
    if not isinstance(_plain(function), FunctionType):
        raise InputError(f"{shown(function)} is not a plain function", field=name)
    wanted, given = PARAMETERS[name], list(inspect.signature(function).parameters)
    if len(given) != len(wanted):
        raise InputError(
            f"takes {len(given)} arguments ({', '.join(given)}); {name} is given {len(wanted)}: {', '.join(wanted)}",
            field=where(function),
        )
    if any(mine in wanted and mine != ours for mine, ours in zip(given, wanted, strict=True)):
        raise InputError(
            f"takes {', '.join(given)}; {name} is given, in this order, {', '.join(wanted)}: keep the order, or use "
            "other names",
            field=where(function),
        )
    # Maps the name that each row has in this hook to its name in PARAMETERS.
    rows = {mine: ours for mine, ours in zip(given, wanted, strict=True) if ours in fields}
    for row, node in _attributes(function):
        if row not in rows:
            continue
        known = [field for field in fields[rows[row]] if field != UNUSED]
        if node.attr not in known:
            raise InputError(
                f"{row}.{node.attr}: no such field{nearest(node.attr, known)} (there are {', '.join(known) or 'none'})",
                field=where(function, node.lineno),
            )
    shared = frozenset(mine for mine, ours in rows.items() if ours in READ_ONLY and name != "opposite")
    for user, use in _uses(function, shared, set()):
        if isinstance(use.ctx, ast.Store):
            raise InputError(
                f"changes {ast.unparse(use)}, which others read too; copy it, or keep it in State",
                field=where(user, use.lineno),
            )
    arrays = frozenset(mine for mine, ours in rows.items() if ours == "a" and lists)
    for user, target in _list_changes(function, arrays, frozenset(), lists, set()):
        raise InputError(
            f"changes {ast.unparse(target)}, a parameter; copy it to an array declared in Arrays",
            field=where(user, target.lineno),
        )
    tree = next(nodes_of(function), None)
    if name in ANSWERS and isinstance(tree, ast.FunctionDef) and not _returns(tree):
        raise InputError(f"returns nothing; return {ANSWERS[name]}", field=where(function))
    for callee in _with_callees(function, set()):
        _refuse_side_effects(callee)


def _returns(tree: ast.AST) -> bool:
    """Return whether a function returns a value other than None somewhere."""
    values = [node.value for node in ast.walk(tree) if isinstance(node, ast.Return)]
    return any(value is not None and ast.unparse(value) != "None" for value in values)


def _refuse_side_effects(function: Callable[..., Any]) -> None:
    """Refuse a function that declares ``global`` or ``nonlocal`` names, or names a random number generator.

    Runs could not be repeated if a hook had a memory of its own or random numbers of its own. A function whose source
    cannot be read is not checked.
    """
    for node in nodes_of(function):
        if isinstance(node, ast.Global | ast.Nonlocal):
            kind = "global" if isinstance(node, ast.Global) else "nonlocal"
            raise InputError(
                f"changes the {kind} {', '.join(node.names)}; keep it in State",
                field=where(function, node.lineno),
            )
    _refuse_chance(function, "use u(d, k)")


def refuse_chance(functions: Iterable[object], instead: str) -> None:
    """Refuse functions that draw random numbers of their own, themselves or in functions of users that they call.

    Args:
        functions: of a task or a sensor; what is no plain Python function of a user is not checked.
        instead: what to use in their place, for the message.
    Raises:
        InputError: one draws random numbers.
    """
    for function in functions:
        if isinstance(function, FunctionType) and not is_shipped(function):
            for callee in _with_callees(function, set()):
                _refuse_chance(callee, instead)


def _refuse_chance(function: Callable[..., Any], instead: str) -> None:
    for node in nodes_of(function):
        if isinstance(node, ast.Attribute | ast.Name) and _is_chance(node, function):
            raise InputError(
                f"draws random numbers of its own, so that runs could not be repeated; {instead}",
                field=where(function, node.lineno),
            )


def _is_chance(node: ast.Attribute | ast.Name, function: Callable[..., Any]) -> bool:
    """Return whether an expression such as ``np.random.random`` names a random number generator.

    Generators are those of the modules in ``CHANCE`` and of ``numpy.random``, whatever name they were imported under.
    """
    attributes: list[str] = []  # those after the first name of the expression
    root_node: ast.expr = node
    while isinstance(root_node, ast.Attribute):
        attributes.append(root_node.attr)
        root_node = root_node.value
    if not isinstance(root_node, ast.Name) or root_node.id not in function.__globals__:
        return False
    value = function.__globals__[root_node.id]
    # ``from random import getrandbits`` gives a method of a generator; some of these methods name no module.
    if type(getattr(value, "__self__", None)).__module__ in CHANCE:
        return True
    # ``module`` is the module that the first name of the expression means or, if that is another object, the module
    # that defines this object. ``__name__`` serves for ``random.random``, which has no ``__module__`` but is named like
    # its module.
    defined_in = getattr(value, "__module__", None) or getattr(value, "__name__", "")
    module = str(getattr(value, "__name__", "")) if inspect.ismodule(value) else str(defined_in)
    if module.partition(".")[0] in CHANCE:
        return True
    # Either the expression names ``random`` after ``np``, or its first name was imported from ``numpy.random``.
    return module.startswith("numpy") and ("random" in attributes or module.startswith("numpy.random"))


def _with_callees(
    function: Callable[..., Any], seen: set[Any], every: bool = False
) -> Iterator[Callable[..., Any]]:
    """Yield the function, and the users' Python functions that it calls, directly or through each other.

    Functions of its own module are among them, whosever it is. ``seen`` holds those already yielded; it grows in place.

    Args:
        every: whether all others are among them too, such as those of this package.
    """
    if function in seen:
        return
    seen.add(function)
    yield function
    for name in function.__code__.co_names:
        value = _plain(function.__globals__.get(name))
        if isinstance(value, FunctionType) and (
            every or value.__module__ == function.__module__ or not is_known(value.__module__)
        ):
            yield from _with_callees(value, seen, every)


def _attributes(function: Callable[..., Any]) -> list[tuple[str, ast.Attribute]]:
    """Return every expression ``name.field`` in a function as name and node; none if the source cannot be read."""
    return [
        (node.value.id, node)
        for node in nodes_of(function)
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name)
    ]


def nodes_of(function: Callable[..., Any]) -> Iterator[ast.AST]:
    """Yield the nodes of a function's syntax tree, whose lines count from the first line of its file.

    There are none if the source cannot be read, as of a function typed at a prompt. Of several lambda expressions that
    begin on the line of ``function``, the nodes of all are yielded.
    """
    plain = _plain(function)
    code = plain.__code__
    text = plain.__globals__.get(TEXT)
    if text is None:
        linecache.checkcache(code.co_filename)  # the file may have changed since it was read
        text = "".join(linecache.getlines(code.co_filename, plain.__globals__))
    for tree in _functions_in(text).get((code.co_name, code.co_firstlineno), ()):
        yield from ast.walk(tree)


@lru_cache(maxsize=64)
def _functions_in(text: str) -> dict[tuple[str, int], list[ast.AST]]:
    """Return the syntax trees of all functions of a file, by name and first line; empty if it cannot be parsed.

    The first line of a function with decorators is that of the first decorator. A lambda expression has Python's name
    for it, ``<lambda>``.
    """
    functions: dict[tuple[str, int], list[ast.AST]] = {}
    try:
        tree = ast.parse(text)
    except (SyntaxError, ValueError):  # ValueError: the text has null bytes
        return functions
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            first = min([node.lineno, *(decorator.lineno for decorator in node.decorator_list)])
            functions.setdefault((node.name, first), []).append(node)
        elif isinstance(node, ast.Lambda):
            functions.setdefault(("<lambda>", node.lineno), []).append(node)
    return functions


def is_shipped(*parts: object) -> bool:
    """Return whether all of these functions and classes are of this package; None counts as one of them.

    Tests check the hooks of shipped strategies and networks, so that a start need not.
    """
    package = f"{__name__.partition('.')[0]}."
    # A function that was made by exec() may have no module: its __module__ is None.
    return all(
        part is None or (getattr(part, "__module__", None) or "").startswith(package) for part in parts
    )


FACTS: Final[dict[str, tuple[str, ...]]] = {
    "T_end": ("t_end_s",),
    "boundary": ("decision_boundary", "boundary", "beliefs"),
    "grid": ("rows", "columns", "tile_width_m", "tile_height_m", "left_m", "bottom_m"),
    "arena": ("width_m", "height_m"),
    "swarm size": ("robots",),
}
"""What a robot knows, and the fields of ``World`` of which its strategy reads at least one in that case."""
OF_RATES: Final = ("false_positive", "false_negative")
"""Fields of error rates. ``boundary``, the boundary of readings, may be computed from error rates as well."""
PLACE: Final = ("x_m", "y_m", "heading_rad", "spread_m", "lagged_x_m", "lagged_y_m")
"""Fields of ``Reading`` that say where this reading, or the lagged one, was taken."""
OF_WORLD: Final = (*OF_RATES, *chain.from_iterable(FACTS.values()))
"""Fields of ``World`` that tell a robot something of its task."""
WORLD, READING = "w", "x"
"""Names of these arguments in ``STRATEGY_HOOKS``."""


def told(strategy: Strategy, boundary_of: str) -> tuple[str, ...]:
    """Return what a robot with this strategy knows of its task, such as "grid" or "error rates".

    Args:
        boundary_of: ``decision.boundary_of``. With "tiles" the error rates are known if the strategy reads them, or the
            boundary that is computed from them. With "readings" robots take readings at face value. A strategy that
            ``knows_error_rates`` knows them in both cases.
    """
    read = fields_read(strategy)
    # A fact is known if the strategy reads at least one of the fields that hold it.
    found = [fact for fact, fields in FACTS.items() if read & set(fields)]
    if strategy.boundary_half and "boundary" not in found:  # a boundary of 1/2 is built into its rules
        found.append("boundary")
    # With "tiles" the boundary of readings, and the table ``beliefs`` for this boundary, are computed from the error
    # rates.
    if strategy.knows_error_rates or (boundary_of == "tiles" and read & {*OF_RATES, "boundary", "beliefs"}):
        found.append("error rates")
    if read & set(PLACE):
        found.append("place of each reading")
    return (*found, *strategy.told)


@cache
def reads_places(strategy: Strategy) -> bool:
    """Return whether the hooks of a strategy read where a reading was taken (``PLACE``)."""
    # Names are looked up in compiled code first, because parsing the source takes a hundred times as long. A user's
    # hook may read a place without its name.
    seen: set[Any] = set()
    hooks = [hook for hook in (getattr(strategy, name) for name in STRATEGY_HOOKS) if hook is not None]
    called = (one for hook in hooks for one in _with_callees(_plain(hook), seen, every=True))
    if is_shipped(*hooks) and all(set(PLACE).isdisjoint(one.__code__.co_names) for one in called):
        return False
    return not fields_read(strategy).isdisjoint(PLACE)


@cache
def fields_read(strategy: Strategy) -> frozenset[str]:
    """Return the fields of ``World`` and ``Reading`` that the strategy's hooks, and functions called by them, read.

    A hook may give its arguments any names, so the name under which it gets the world or the reading is found first.
    """
    read: set[str] = set()
    for row, every in ((WORLD, OF_WORLD), (READING, PLACE)):
        # Functions analysed already, each with the names of its arguments that are this row.
        seen: set[tuple[Any, frozenset[str]]] = set()
        for hook, parameters in STRATEGY_HOOKS.items():
            function = getattr(strategy, hook)
            if function is None:
                continue
            given = inspect.signature(_plain(function)).parameters
            mine = frozenset(name for name, ours in zip(given, parameters, strict=True) if ours == row)
            for _, node in _uses(function, mine, seen):
                if isinstance(node, ast.Attribute):
                    read.add(node.attr)
                elif isinstance(node, ast.Name):  # the row as a whole: any field of it may be read
                    read.update(every)
    return frozenset(read)


def _plain(function: Any) -> Any:
    return getattr(function, "py_func", function)


def _callee(
    function: Callable[..., Any], call: ast.Call
) -> Iterator[tuple[Callable[..., Any], dict[str, ast.expr]]]:
    """Yield the function that is called by its name, with its arguments by their names; nothing if it is not known."""
    found = _plain(function.__globals__.get(call.func.id)) if isinstance(call.func, ast.Name) else None
    if isinstance(found, FunctionType):
        names = list(inspect.signature(found).parameters)
        by_name = {word.arg: word.value for word in call.keywords if word.arg in names}
        yield found, dict(zip(names, call.args, strict=False)) | by_name


def _list_changes(
    function: Callable[..., Any],
    rows: frozenset[str],
    arrays: frozenset[str],
    lists: Collection[str],
    seen: set[tuple[Any, frozenset[str], frozenset[str]]],
) -> Iterator[tuple[Callable[..., Any], ast.expr]]:
    """Yield where a function, or one that it calls, changes arrays that are parameters: the function and the target.

    Args:
        rows: names of the arguments whose fields ``lists`` are these arrays. arrays: names of arguments that are such
            arrays themselves. seen: functions analysed already, each with its names; it grows in place.
    """
    plain = _plain(function)
    if not (rows or arrays) or (plain, rows, arrays) in seen:
        return
    seen.add((plain, rows, arrays))
    nodes = list(nodes_of(plain))

    def is_row(node: ast.expr) -> bool:
        return isinstance(node, ast.Name) and node.id in rows

    def is_list(node: ast.expr) -> bool:
        if isinstance(node, ast.Subscript):  # a part of an array shares its memory
            return isinstance(node.slice, ast.Slice) and is_list(node.value)
        if isinstance(node, ast.Attribute):
            return is_row(node.value) and node.attr in lists
        return isinstance(node, ast.Name) and node.id in arrays

    named = [
        (target.id, node.value)
        for node in nodes
        if isinstance(node, ast.Assign)
        for target in node.targets
        if isinstance(target, ast.Name)
    ]
    for _ in named:  # a name may be given to what another name stands for
        rows |= {name for name, value in named if is_row(value)}
        arrays |= {name for name, value in named if is_list(value)}
    for node in nodes:
        if isinstance(node, ast.Subscript | ast.Attribute) and isinstance(node.ctx, ast.Store):
            if is_list(node.value if isinstance(node, ast.Subscript) else node):
                yield plain, node
        elif isinstance(node, ast.AugAssign) and is_list(node.target):
            yield plain, node.target
        elif isinstance(node, ast.Call):
            for callee, given in _callee(plain, node):
                yield from _list_changes(
                    callee,
                    frozenset(name for name, item in given.items() if is_row(item)),
                    frozenset(name for name, item in given.items() if is_list(item)),
                    lists,
                    seen,
                )


def _uses(
    function: Callable[..., Any], rows: frozenset[str], seen: set[tuple[Any, frozenset[str]]]
) -> Iterator[tuple[Callable[..., Any], ast.Attribute | ast.Subscript | ast.Name]]:
    """Yield how a function uses its arguments ``rows``, itself or in functions that it passes them to.

    Yields:
        The function that uses one, and the expression: a field, an element of a field that is an array, or the row's
        name where it is neither read by its fields, given another name, nor passed to a function that is known.

    Args:
        rows: names of the arguments: those that are the world or the reading, or that must not be changed. seen:
            functions analysed already, each with its ``rows``; it grows in place.
    """
    plain = _plain(function)
    nodes = list(nodes_of(plain))
    rows |= {
        other.id
        for node in nodes
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Name) and node.value.id in rows
        for other in node.targets
        if isinstance(other, ast.Name)
    }
    if not rows or (plain, rows) in seen:
        return
    seen.add((plain, rows))
    if not nodes:  # without source: by the names in its code
        yield from (
            (plain, ast.Attribute(ast.Name("row"), name, ast.Load())) for name in plain.__code__.co_names
        )

    def is_row(node: ast.expr) -> bool:
        return isinstance(node, ast.Name) and node.id in rows

    known = set[int]()  # of the names of rows, those whose use is known
    for node in nodes:
        if isinstance(node, ast.Attribute) and is_row(node.value):
            known.add(id(node.value))
            yield plain, node
        elif (
            isinstance(node, ast.Subscript)
            and isinstance(node.value, ast.Attribute)
            and is_row(node.value.value)
        ):
            yield plain, node
        elif isinstance(node, ast.Assign) and all(isinstance(other, ast.Name) for other in node.targets):
            known.add(id(node.value))
        elif isinstance(node, ast.Call):
            for callee, given in _callee(plain, node):
                passed = {name: item for name, item in given.items() if is_row(item)}
                known |= {id(item) for item in passed.values()}
                yield from _uses(callee, frozenset(passed), seen)
    for node in nodes:
        if (
            isinstance(node, ast.Name)
            and isinstance(node.ctx, ast.Load)
            and is_row(node)
            and id(node) not in known
        ):
            yield plain, node
