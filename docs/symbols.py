"""Typeset symbols in running text: ``theta_E``, ``T_end``, ``10^-12`` and names of Greek letters become formulas.

The sources keep the words, which read well as text and are what a search looks for.
"""

from __future__ import annotations

import re
from typing import Any, Final

from docutils import nodes
from sphinx.transforms.post_transforms import SphinxPostTransform

GREEK: Final = (
    *(
        "alpha",
        "beta",
        "gamma",
        "delta",
        "eps",
        "epsilon",
        "eta",
        "theta",
        "kappa",
        "lambda",
        "mu",
        "omega",
        "phi",
    ),
    *("pi", "sigma", "tau"),
)
SYMBOL: Final = re.compile(
    rf"(?<![\w.\\/-])(?:(?P<power>\d+)\^(?P<exponent>-?\d+)"
    rf"|(?P<base>{'|'.join(GREEK)}|[A-Za-z])(?:_(?P<sub>[A-Za-z0-9]+))?(?:\^(?P<sup>max|[a-z*]))?)"
    r"(?![\w(*^]|-\w|\.\w| function| distribution)"
)
"""A power, or a letter with an index; a Latin letter alone stays text."""
LEFT_AS_THEY_ARE: Final = (
    nodes.literal, nodes.literal_block, nodes.math, nodes.math_block, nodes.title, nodes.raw, nodes.reference,
)  # fmt: skip


def formula(found: re.Match[str]) -> str | None:
    """Return a symbol in LaTeX's notation; None for a word that is not one."""
    if found["power"]:
        return f"{found['power']}^{{{found['exponent']}}}"
    base, sub, sup = found["base"], found["sub"], found["sup"]
    if base not in GREEK and not sub:
        return None
    text = {"eps": r"\epsilon"}.get(base, rf"\{base}" if base in GREEK else base)
    if sub:
        text += f"_{{{sub}}}" if len(sub) == 1 or sub.isdigit() else rf"_\mathrm{{{sub}}}"
    if sup:
        text += r"^\mathrm{max}" if sup == "max" else f"^{{{sup}}}"
    return text


def typeset(text: str) -> list[nodes.Node]:
    """Split a text into texts and formulas."""
    parts: list[nodes.Node] = []
    end = 0
    for found in SYMBOL.finditer(text):
        latex = formula(found)
        if latex is None:
            continue
        parts += [nodes.Text(text[end : found.start()])] if found.start() > end else []
        parts.append(nodes.math(latex, latex))
        end = found.end()
    return [*parts, nodes.Text(text[end:])] if end < len(text) else parts


class Symbols(SphinxPostTransform):
    """Typeset the symbols of a page; pages of the API and of commands have names of Python's and of options."""

    default_priority = 5
    formats = ("html",)

    def run(self, **_: Any) -> None:
        """Replace texts in place."""
        if self.env.current_document.docname.startswith(("api/", "commands")):
            return
        for text in list(self.document.findall(nodes.Text)):
            above, is_prose = text.parent, True
            while above is not None and is_prose:
                is_prose, above = not isinstance(above, LEFT_AS_THEY_ARE), above.parent
            parts = typeset(str(text)) if is_prose else []
            if any(isinstance(part, nodes.math) for part in parts):
                text.parent.replace(text, parts)


def setup(app: Any) -> dict[str, bool]:
    """Register the transform."""
    app.add_post_transform(Symbols)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
