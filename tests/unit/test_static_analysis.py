"""The analysis of hooks: shipped strategies and networks pass it, which a start takes for granted."""

from __future__ import annotations

import ast
import linecache
from dataclasses import replace
from functools import partial
from hashlib import sha256

import pytest

from vibroswarm import networks, strategies
from vibroswarm.errors import InputError
from vibroswarm.result import code_files
from vibroswarm.scenario import plugins
from vibroswarm.strategies import place_options, places, soft, static_analysis
from vibroswarm.strategies.static_analysis import check_function, fields_read, nodes_of, reads_places

SIZES = {"tiles": 25, "longest_mm": 1000}
OPTIONS = [{"energies": True}, {"draws": 2}, {"share_map": True}]
"""Options of ``places``, each of which gives a strategy of other hooks."""
VARIANTS = [
    place_options.with_options(places.places, places.places.params(**option), SIZES) for option in OPTIONS
]


@pytest.mark.parametrize("strategy", [*strategies.known().values(), *VARIANTS], ids=lambda one: one.name)
def test_hooks_of_shipped_strategies_have_no_errors(strategy):
    strategy.check_hooks()


@pytest.mark.parametrize("network", networks.known().values(), ids=lambda one: one.name)
def test_hooks_of_shipped_networks_have_no_errors(network):
    network.check_hooks()


def decision(s, a, p, w):
    return s.no_such_field


class State:
    decided: int


class Params:
    decided: int = 0


@pytest.mark.parametrize("part", [{"decision": decision}, {"state": State}, {"params": Params}])
def test_a_shipped_strategy_with_a_part_of_the_users_is_checked(part):
    with pytest.raises(InputError, match="no such field"):
        replace(soft.soft, **part)


def test_a_file_is_parsed_once_for_all_hooks(monkeypatch):
    parse, parsed = ast.parse, []
    text = "".join(linecache.getlines(soft.__file__))
    monkeypatch.setattr(ast, "parse", lambda given: parsed.append(given) or parse(given))
    static_analysis._functions_in.cache_clear()
    soft.soft.check_hooks()
    fields_read(soft.soft)
    assert parsed.count(text) == 1


def typed(text, name="hook", **space):
    """A function whose file is ``text``, as that of a notebook's cell."""
    file = f"<typed {abs(hash(text))}>"
    linecache.cache[file] = (len(text), None, text.splitlines(keepends=True), file)
    exec(compile(text, file, "exec"), space)  # noqa: S102  (our own text)
    return space[name]


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("\n\ndef hook(s, a, p, w):\n    return s.wrong\n", 4),
        ("def hook(x): pass\n\ndef hook(s, a, p, w):\n    y = 1\n    return s.wrong\n", 5),
        ("@staticmethod\ndef hook(s, a, p, w):\n    return s.wrong\nhook = hook.__wrapped__\n", 3),
        ("if True:\n    def hook(s, a, p, w):\n        return s.wrong\n", 3),
        ("hook = (\n    lambda s, a, p, w:\n    s.wrong)\n", 3),
        (
            "def made():\n    def hook(s, a, p, w):\n        return s.wrong\n    return hook\nhook = made()\n",
            3,
        ),
    ],
    ids=["function", "second of its name", "decorated", "indented", "lambda", "within another"],
)
def test_an_error_is_found_with_its_line(text, line):
    hook = typed(text)
    with pytest.raises(InputError, match=rf"line {line}, in .*s\.wrong: no such field"):
        check_function("decision", hook, {"s": ("right",)})


PLACED = """from vibroswarm.strategies import strategy_in


class State:
    n: int


def begin(s, a, d, p, w):
    s.n = 0


def on_sample(s, a, x, out, d, p, w):
    s.n += x.x_m > 0.5
    return True


def decision(s, a, p, w):
    return -1


placed = strategy_in(__name__, "placed")
"""


@pytest.mark.parametrize(
    "how",
    [
        "q = x\n    return q.x_m",
        "(q := x)\n    return q.x_m",
        "q = (x, 1)\n    return q[0].x_m",
        "return x[3]",
        "return (lambda y: y.x_m)(x)",
        "def f(y):\n        return y.x_m\n    return f(x)",
        "return among(x)",
    ],
)
def test_a_place_that_is_read_in_another_way_is_read(how):
    """Otherwise robots would be given their true places without a word."""
    text = f"def among(*rows):\n    return rows[0].x_m\n\n\ndef hook(s, a, x, out, d, p, w):\n    {how}\n"
    assert reads_places(replace(soft.soft, on_sample=typed(text)))
    assert not reads_places(soft.soft)


@pytest.mark.parametrize(
    ("how", "line", "words"),
    [
        ("q = p\n    q.lead += 1", 8, r"changes q\.lead"),
        ("bump(p)", 2, r"in bump: changes row\.lead"),
        ("bump(row=p)", 2, r"in bump: changes row\.lead"),
        ("m.shares[2] = 1", 7, r"changes m\.shares\[2\]"),
        ("again(m)", 4, r"in again: changes row\.shares\[0\]"),
    ],
)
def test_what_others_read_is_not_changed_by_other_names(how, line, words):
    text = "def bump(row):\n    row.lead += 1\ndef again(row):\n    row.shares[0] = 1\n"
    hook = typed(f"{text}\ndef hook(s, a, m, sender, t_s, d, p, w):\n    {how}\n")
    fields = {"p": ("lead",), "m": ("shares",), "s": ("lead",)}
    with pytest.raises(InputError, match=rf"line {line}, .*{words}, which others read too"):
        check_function("on_message", hook, fields)
    changes_its_own = typed(f"{text}\ndef hook(s, a, m, sender, t_s, d, p, w):\n    bump(s)\n")
    check_function("on_message", changes_its_own, fields)


@pytest.mark.parametrize(
    ("how", "line", "words"),
    [
        ("b.parents[0] += 1", 5, r"changes b\.parents\[0\]"),
        ("move(b)", 2, r"in move: changes row\.parents\[1\]"),
        ("c = b.parents; c[0] = 1", 5, r"changes c\[0\]"),
        ("c = b; e = c.parents[1:]; e += 1", 5, r"changes e"),
        ("shift(values=b.parents)", 3, r"in shift: changes values\[0\]"),
    ],
)
def test_a_list_that_is_a_parameter_is_not_changed(how, line, words):
    text = "def move(row):\n    row.parents[1] = 1\ndef shift(values): values[0] = 2"
    names = "n, b, sender, tick, number, bytes_on_air, x_m, y_m, arrival_tick, d, p, w"
    fields = {"a": ("parents", "load")}
    with pytest.raises(InputError, match=rf"line {line}, .*{words}, a parameter; copy it"):
        check_function("send", typed(f"{text}\ndef hook({names}):\n    {how}\n"), fields, ("parents",))
    check_function(
        "send",
        typed(f"def hook({names}):\n    c = b.parents[0]; c += 1; b.load[0] += c\n"),
        fields,
        ("parents",),
    )


def test_files_of_one_name_are_not_taken_for_each_other():
    """A worker process knows only their names, and whether places are read decides how robots find them."""
    other = PLACED.replace("x.x_m > 0.5", "1").replace("placed", "unplaced")
    texts = {"placed": PLACED, "unplaced": other}
    codes = {
        name: f"mine.py:{name}{plugins.HASH}{sha256(text.encode()).hexdigest()}"
        for name, text in texts.items()
    }
    try:
        plugins.install_all((codes[name], text) for name, text in texts.items())
        read = {name: reads_places(strategies.strategy(name)) for name in texts}
    finally:
        for name in texts:
            strategies.base.forget(name)
    assert read == {"placed": True, "unplaced": False}
    with pytest.raises(InputError, match="two different files have this name"):
        code_files([], *codes.values())


@pytest.mark.parametrize(
    ("hook", "words"),
    [
        (partial(soft.soft.decision), "is not a plain function"),
        (
            typed("def hook(s, a, p, w):\n    if w.robots:\n        return None\n    return\n"),
            "returns nothing",
        ),
    ],
)
def test_what_is_no_hook_is_refused_in_words(hook, words):
    with pytest.raises(InputError, match=words):
        check_function("decision", hook, {})


def test_a_function_without_a_source_has_no_nodes():
    space = {}
    exec("def hook(s, a, p, w): return s.wrong", space)  # noqa: S102  (our own text)
    assert list(nodes_of(space["hook"])) == []
    check_function("decision", space["hook"], {"s": ("right",)})


def test_a_place_is_read_in_a_function_without_a_source():
    space = {}
    exec("def hook(s, a, x, out, d, p, w): return x.y_m", space)  # noqa: S102  (our own text)
    assert reads_places(replace(soft.soft, on_sample=space["hook"]))
