"""``vibroswarm check``: check whether user code obeys the contract of its kind."""

from __future__ import annotations

import argparse
from typing import Any, Final

from vibroswarm.cli.options import add_json

KINDS: Final = {
    "strategy": "strategy",
    "network": "network",
    "task": "task",
    "motion": "motion source",
}
"""Values of ``--kind``, and their names in messages."""


def add_parser(commands: Any) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "check",
        help="check a strategy, network, task or motion source of your own",
        description="Check a strategy, network, task or motion source: does it compile, repeat, give the same results "
        "in pieces and in plain Python, and return what it should? Its kind is detected.",
        epilog="examples:\n  vibroswarm check voter.py:voter\n  vibroswarm check soft\n  vibroswarm check event",
    )
    parser.add_argument("name", metavar="NAME", help="FILE.py:NAME, or a known name")
    parser.add_argument("--kind", choices=list(KINDS), help="its kind, if several have that name")
    add_json(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run the checks and print their results; returns 1 if one fails."""
    from vibroswarm.cli.output import print_json, print_paragraph
    from vibroswarm.testing import check_motion, check_network, check_strategy, check_task

    kind, name = _kind_and_name(arguments.kind, arguments.name)
    checks = {
        "strategy": check_strategy,
        "network": check_network,
        "task": check_task,
        "motion": check_motion,
    }
    results = checks[kind](name)
    failed = any(not result.holds and not result.is_warning for result in results)
    if arguments.json:
        print_json([{"check": result.what, "holds": result.holds, "why": result.why} for result in results])
        return int(failed)
    count = f"{sum(result.holds for result in results)} of {len(results)} checks"
    print(f"'{name}' {'fails' if failed else 'passes'}: {count} hold.")
    for result in results:
        mark = "ok  " if result.holds else ("note" if result.is_warning else "FAIL")
        print_paragraph(f"  {mark}  {result.what}{f': {result.why}' if result.why else ''}")
    return int(failed)


def _kind_and_name(kind: str | None, text: str) -> tuple[str, str]:
    """Find what ``text`` names; loads it if it is a file.

    Raises:
        InputError: nothing has that name, or several kinds have it, or the file cannot be loaded.
    """
    import vibroswarm.simulation  # noqa: F401  (registers the engines)
    from vibroswarm.errors import InputError, nearest
    from vibroswarm.scenario import plugins

    if plugins.is_code(text):
        return str(plugins.kind_of(plugins.load_file(kind, text))), plugins.name_in(text)
    known = {kind_name: plugins.KINDS[kind_name].known() for kind_name in ([kind] if kind else KINDS)}
    if not any(text in names for names in known.values()):
        plugins.load_installed()
    kinds = [kind_name for kind_name, names in known.items() if text in names]
    if not kinds:
        names_of = {kind_name: list(names) for kind_name, names in known.items()}
        every = [name for names in names_of.values() for name in names]
        expected = KINDS[kind] if kind else f"{', '.join(list(KINDS.values())[:-1])} or {KINDS['motion']}"
        listed = "; ".join(f"{KINDS[kind_name]}: {', '.join(names)}" for kind_name, names in names_of.items())
        raise InputError(
            f"unknown {expected} '{text}'{nearest(text, every)} ({listed}; or FILE.py:NAME)", field="NAME"
        )
    if len(kinds) > 1:
        both = " and a ".join(KINDS[kind_name] for kind_name in kinds)
        raise InputError(f"'{text}' is a {both}; add --kind", field="NAME")
    return kinds[0], text
