"""``vibroswarm check``: check whether user code obeys the contract of its kind."""

from __future__ import annotations

from typing import Annotated, Final, Literal

from vibroswarm.cli.command_line import Option
from vibroswarm.cli.deliver import print_document
from vibroswarm.cli.options import Json

KINDS: Final = {
    "strategy": "strategy",
    "network": "network",
    "task": "task",
    "sensor": "sensor",
    "motion": "motion source",
}
"""Values of ``--kind``, and their names in messages."""


def check(
    name: Annotated[str, Option("FILE.py:NAME, or a known name", "NAME")],
    /,
    *,
    kind: Annotated[
        Literal["strategy", "network", "task", "sensor", "motion"] | None,
        Option("{names}, if several have that name", "KIND"),
    ] = None,
    json: Json = False,
) -> int:
    """Check a strategy, network, task, sensor or motion source.

    It must compile, repeat, give the same results in another process in plain Python, and return what it should.
    Its kind is detected. The exit code is 1 if a check fails; one that only warns does not count as failed.

    examples:
      vibroswarm check voter.py:voter
      vibroswarm check soft
      vibroswarm check event
    """
    from vibroswarm.documents.check import check_document
    from vibroswarm.errors import InputError
    from vibroswarm.testing import CHECKS

    kind_found, known_name = _kind_and_name(kind, name)
    if kind_found not in CHECKS:
        raise InputError(f"is a {kind_found}, which is not checked", field="NAME")
    results = CHECKS[kind_found](known_name)
    failed = any(not result.holds and not result.is_warning for result in results)
    rows = [(result.what, result.holds, result.is_warning, result.why) for result in results]
    print_document(check_document(known_name, rows), as_json=json)
    return int(failed)


def _kind_and_name(kind: str | None, text: str) -> tuple[str, str]:
    """Find which object ``text`` names; load it if it is given as FILE.py:NAME.

    Args:
        kind: a key of ``KINDS``, or None to search all kinds.
    Returns:
        The object's kind, and the name under which it is registered.
    Raises:
        InputError: nothing has that name, or several kinds have it, or the file cannot be loaded.
    """
    import vibroswarm.simulation  # noqa: F401  (registers the engines)
    from vibroswarm.errors import InputError, nearest
    from vibroswarm.scenario import plugins

    if plugins.is_code(text):
        loaded = plugins.load_file(kind, text)  # registers an object of this kind; with None, of any kind
        # ``kind_of`` returns None for objects of no kind, which ``load_file`` refuses; ``str`` is for the type checker.
        return str(plugins.kind_of(loaded)), plugins.name_in(text)
    known = {kind_name: plugins.KINDS[kind_name].known() for kind_name in ([kind] if kind else KINDS)}
    # Installed packages may register more names. `known` holds views of the registries, so it has these names too.
    for wanted in (text, None):
        if not any(text in names for names in known.values()):
            for kind_name in known:
                plugins.load_installed(kind_name, wanted)
    kinds = [kind_name for kind_name, names in known.items() if text in names]
    if not kinds:  # the error message lists all known names by kind
        names_of = {kind_name: list(names) for kind_name, names in known.items()}
        every = [name for names in names_of.values() for name in names]
        *first_kinds, last_kind = KINDS.values()
        expected = KINDS[kind] if kind else f"{', '.join(first_kinds)} or {last_kind}"
        listed = "; ".join(f"{KINDS[kind_name]}: {', '.join(names)}" for kind_name, names in names_of.items())
        raise InputError(
            f"unknown {expected} '{text}'{nearest(text, every)} ({listed}; or FILE.py:NAME)", field="NAME"
        )
    if len(kinds) > 1:
        both = " and a ".join(KINDS[kind_name] for kind_name in kinds)
        raise InputError(f"'{text}' is a {both}; add --kind", field="NAME")
    return kinds[0], text
