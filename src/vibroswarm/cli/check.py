"""``vibroswarm check``: whether a strategy of one's own holds to what every strategy must."""

from __future__ import annotations

import argparse
import json
from typing import Any


def add_parser(commands: Any) -> None:
    """Make the command known."""
    parser = commands.add_parser(
        "check",
        help="check a strategy of your own",
        description="Check a strategy: does it compile, repeat, do compiled what it does in plain Python, and decide?",
        epilog="examples:\n  vibroswarm check voter.py:voter\n  vibroswarm check soft",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("strategy", metavar="NAME", help="FILE.py:NAME, or the name of one that is known")
    parser.add_argument(
        "--json", action="store_true", help="give the outcome as JSON, and nothing else, on stdout"
    )
    parser.set_defaults(run=run, parser=parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the checks and say what they found; 1 if one fails."""
    from vibroswarm.cli.scenarios import chosen
    from vibroswarm.code_files import is_code, name_in
    from vibroswarm.testing import check_strategy

    text = chosen("strategy", arguments.strategy)
    name = name_in(text) if is_code(text) else text
    found = check_strategy(name)
    wrong = [one for one in found if not one.holds and not one.only_told]
    if arguments.json:
        print(
            json.dumps([{"check": one.what, "holds": one.holds, "why": one.why} for one in found], indent=1)
        )
        return 1 if wrong else 0
    count = f"{len(found) - len(wrong)} of {len(found)} checks"
    print(f"'{name}' {'fails' if wrong else 'passes'}: {count} hold.")
    for one in found:
        mark = "ok  " if one.holds else ("note" if one.only_told else "FAIL")
        print(f"  {mark}  {one.what}{f': {one.why}' if one.why else ''}")
    return 1 if wrong else 0
