"""``vibroswarm check``: whether code of one's own holds to what everything of its kind must."""

from __future__ import annotations

import argparse
import json
from typing import Any, Final

KINDS: Final = {
    "strategy": "strategy",
    "network": "network",
    "task": "task",
    "motion": "source of motion",
}
"""As ``--kind`` calls them, and in words."""


def add_parser(commands: Any) -> None:
    """Make the command known."""
    parser = commands.add_parser(
        "check",
        help="check a strategy, network, task or source of motion of your own",
        description="Check a strategy, a network, a task or a source of motion: does it compile, repeat, do the same "
        "in pieces and in plain Python, and give what it should? It is found out which of them it is.",
        epilog="examples:\n  vibroswarm check voter.py:voter\n  vibroswarm check soft\n  vibroswarm check event",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("name", metavar="NAME", help="FILE.py:NAME, or the name of one that is known")
    parser.add_argument("--kind", choices=list(KINDS), help="what it is, where several have the name")
    parser.add_argument(
        "--json", action="store_true", help="give the outcome as JSON, and nothing else, on stdout"
    )
    parser.set_defaults(run=run, parser=parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the checks and say what they found; 1 if one fails."""
    from vibroswarm.testing import check_motion, check_network, check_strategy, check_task

    kind, name = _found(arguments.kind, arguments.name)
    checks = {
        "strategy": check_strategy,
        "network": check_network,
        "task": check_task,
        "motion": check_motion,
    }
    found = checks[kind](name)
    wrong = [one for one in found if not one.holds and not one.only_told]
    if arguments.json:
        print(
            json.dumps([{"check": one.what, "holds": one.holds, "why": one.why} for one in found], indent=1)
        )
        return 1 if wrong else 0
    count = f"{sum(one.holds for one in found)} of {len(found)} checks"
    print(f"'{name}' {'fails' if wrong else 'passes'}: {count} hold.")
    for one in found:
        mark = "ok  " if one.holds else ("note" if one.only_told else "FAIL")
        print(f"  {mark}  {one.what}{f': {one.why}' if one.why else ''}")
    return 1 if wrong else 0


def _found(kind: str | None, text: str) -> tuple[str, str]:
    """The kind and the name of what a user names; a file is loaded.

    Raises:
        InputError: there is no such thing, or several kinds have it; the file cannot be loaded.
    """
    import vibroswarm.simulation  # noqa: F401  (makes the engines known)
    from vibroswarm import code_files
    from vibroswarm.errors import InputError, nearest

    if code_files.is_code(text):
        is_a = code_files.kind_of(code_files.load_file(kind, text))
        return str(is_a), code_files.name_in(text)
    known = {one: code_files.KINDS[one].known() for one in ([kind] if kind else KINDS)}
    if not any(text in names for names in known.values()):
        code_files.load_installed()
    kinds = [one for one, names in known.items() if text in names]
    if not kinds:
        there = {one: list(names) for one, names in known.items()}
        every = [name for names in there.values() for name in names]
        wanted = KINDS[kind] if kind else f"{', '.join(list(KINDS.values())[:-1])} or {KINDS['motion']}"
        listed = "; ".join(f"{KINDS[one]}: {', '.join(names)}" for one, names in there.items())
        raise InputError(
            f"there is no {wanted} '{text}'{nearest(text, every)} ({listed}; or FILE.py:NAME)", field="NAME"
        )
    if len(kinds) > 1:
        both = " and a ".join(KINDS[one] for one in kinds)
        raise InputError(f"there is a {both} '{text}'; say which by --kind", field="NAME")
    return kinds[0], text
