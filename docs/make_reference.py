"""Write scenario.md from the fields of the scenario: ``python docs/make_reference.py``."""

from __future__ import annotations

import ast
from pathlib import Path

import tomli_w

from vibroswarm import fields
from vibroswarm.presets import describe, preset_names
from vibroswarm.scenario import Scenario

TARGET = Path(__file__).with_name("scenario.md")
HEAD = """\
# The scenario

<!-- Made by docs/make_reference.py from the sources; a test holds it to them. -->

A scenario is a TOML file of the sections below. What is left out is as in preset `paper`, or as in the preset that
`preset = "text"` at its head names. An unknown key is an error. `floor.source` may also name a floor file beside the
scenario file. On the command line any field is set by `--set section.field=value`; from Python by
`Scenario.with_values({"section.field": value})`. A field without a default may be left out.

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
    """The words below each field of each section, by class name."""
    tree = ast.parse(Path(fields.__file__).read_text(encoding="utf-8"))
    found: dict[str, dict[str, str]] = {}
    for node in tree.body:
        if not isinstance(node, ast.ClassDef):
            continue
        words = found.setdefault(node.name, {})
        for item, after in zip(node.body, node.body[1:], strict=False):
            named = isinstance(item, ast.AnnAssign) and isinstance(item.target, ast.Name)
            told = isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
            if named and told:
                text = " ".join(str(after.value.value).split())  # type: ignore[attr-defined]
                words[item.target.id] = text.replace("``", "`")  # type: ignore[union-attr]
    return found


def default_words(value: object) -> str:
    """A default as TOML writes it."""
    if value is None:
        return ""
    return f"`{tomli_w.dumps({'x': value}, multiline_strings=False).strip().removeprefix('x = ')}`".replace(
        "\n", " "
    )


def tables_of(kind: type[fields.Choice]) -> list[str]:
    """The tables of a section's parts, one for each that has parameters."""
    lines = []
    for name, one in kind.known().items():
        if not one.params.model_fields or one.code:
            continue  # without parameters, or a file of somebody's
        lines += ["", f"### [{kind.kind}.{name}]", "", f"{one.about[:1].upper()}{one.about[1:]}.", ""]
        lines += ["| field | default | what it is |", "|---|---|---|"]
        for field, info in one.params.model_fields.items():
            lines.append(f"| `{field}` | {default_words(info.default)} | {info.description or ''} |")
    return lines


def reference() -> str:
    """The whole document."""
    words = field_docs()
    lines = [HEAD + "\n".join(f"- `{name}`: {describe(name)}" for name in preset_names()), ""]
    for section, info in Scenario.model_fields.items():
        kind = info.annotation
        assert kind is not None
        lines += [
            "",
            f"## [{section}]",
            "",
            str(kind.__doc__).replace("``", "`"),
            "",
            "| field | default | what it is |",
            "|---|---|---|",
        ]
        for name, field in kind.model_fields.items():
            told = words[kind.__name__].get(name) or words["Choice"][name]
            lines.append(f"| `{name}` | {default_words(field.default)} | {told} |")
        if issubclass(kind, fields.Choice):
            lines += tables_of(kind)
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    TARGET.write_text(reference(), encoding="utf-8")
