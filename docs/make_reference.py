"""Generate scenario.md from the fields of the scenario."""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Iterable
from pathlib import Path

import tomli_w

from vibroswarm.scenario import choices, disturbance_fields, fields, localisation_fields
from vibroswarm.scenario.presets import describe, preset_names
from vibroswarm.scenario.scenario import Scenario

TARGET = Path(__file__).with_name("scenario.md")
HEAD = """\
# The scenario

<!-- Made from the source by the build of the site. -->

A scenario is a TOML file with the sections below. Missing fields are as in preset `paper`, or as in the preset named
at the top (`preset = "text"`). Unknown keys are errors. `floor.source` may also name a floor file next to the
scenario file. On the command line `--set section.field=value` sets any field; in Python
`Scenario.with_values({"section.field": value})` does. Defaults are in brackets; fields without one are optional.
Where a file of yours defines a sensor, strategy, network or task, the section's field `code` names the file, with its
SHA-256.

```toml
preset = "paper-empirical"

[swarm]
robots = 8

[strategy]
name = "soft"
```

## Presets

"""


def field_docs() -> dict[str, dict[str, str]]:
    """The docstring below each field of each section, by class name."""
    texts = (
        Path(module.__file__).read_text(encoding="utf-8")
        for module in (fields, choices, disturbance_fields, localisation_fields)
    )
    return described_fields(texts)


def described_fields(texts: Iterable[str]) -> dict[str, dict[str, str]]:
    """The docstring below each field of each class of some sources, by class name."""
    found: dict[str, dict[str, str]] = {}
    for node in (node for text in texts for node in ast.parse(text).body):
        if not isinstance(node, ast.ClassDef):
            continue
        words = found.setdefault(node.name, {})
        for item, after in zip(node.body, node.body[1:], strict=False):
            named = isinstance(item, ast.AnnAssign) and isinstance(item.target, ast.Name)
            described = isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
            if named and described:
                text = " ".join(str(after.value.value).split())  # type: ignore[attr-defined]
                words[item.target.id] = text.replace("``", "`")  # type: ignore[union-attr]
    return found


def default_words(value: object) -> str:
    """A default as TOML writes it, in brackets."""
    if value is None:
        return ""
    text = tomli_w.dumps({"x": value}, multiline_strings=False).strip().removeprefix("x = ")
    one_line = re.sub(r"\s*\n\s*", " ", text).replace("[ ", "[").replace(", ]", "]")
    return f" (`{one_line}`)"


def parameters_of(kind: type[choices.Choice]) -> list[str]:
    """Fields of the choices of a section that have parameters; one that an earlier choice has is referred to."""
    lines = []
    first: dict[str, str] = {}
    for name, one in kind.known().items():
        if not one.params.model_fields or one.code:
            continue  # without parameters, or from a user's file
        lines += [
            "",
            f"### [{kind.kind}.{name}]",
            "",
            f"{one.about[:1].upper()}{one.about[1:]}{'' if one.about.endswith('?') else '.'}",
            "",
        ]
        file = Path(choices.__file__).parents[1] / f"{kind.kind}s" / f"{name}.py"
        words = (
            described_fields([file.read_text(encoding="utf-8")]).get("Params", {}) if file.exists() else {}
        )
        rows = {}
        for field, info in one.params.model_fields.items():
            told = info.description or words.get(field, "")
            rows[field] = f"- `{field}`{default_words(info.default)}: {told}"
        own = [row for row in rows.values() if row not in first]
        lines += [*own, ""] if own else []
        for earlier in dict.fromkeys(first[row] for row in rows.values() if row in first):
            same = (f"`{field}`" for field, row in rows.items() if first.get(row) == earlier)
            lines += [f"As in `[{kind.kind}.{earlier}]`: {', '.join(same)}.", ""]
        first |= dict.fromkeys(own, name)
        lines.pop()
    return lines


def reference() -> str:
    """The whole document."""
    words = field_docs()
    lines = [HEAD + "\n".join(f"- `{name}`: {describe(name)}" for name in preset_names())]
    for section, info in Scenario.model_fields.items():
        kind = info.annotation
        assert kind is not None
        lines += [
            "",
            f"## [{section}]",
            "",
            inspect.cleandoc(str(kind.__doc__)).replace("``", "`"),
            "",
        ]
        for name, field in kind.model_fields.items():
            if name == "code":
                continue  # the head of the page has it
            told = next(
                words[base.__name__][name] for base in kind.__mro__ if name in words.get(base.__name__, {})
            )
            lines.append(f"- `{name}`{default_words(field.default)}: {told}")
        if issubclass(kind, choices.Choice):
            lines += parameters_of(kind)
    return "\n".join(lines) + "\n"
