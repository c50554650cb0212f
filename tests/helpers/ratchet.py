"""Print the size of the package, its folders and the tests; fail if one exceeds its limit in ``pyproject.toml``.

Sizes are statements without docstrings, and expression nodes. Each change that lands lowers the limits to what is
printed.
"""

from __future__ import annotations

import ast
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "src" / "vibroswarm"


def size(folder: Path) -> list[int]:
    """Statements without docstrings, and expression nodes, of all Python files in a folder."""
    texts = [path.read_text(encoding="utf-8") for path in folder.rglob("*.py")]
    nodes = [node for text in texts for node in ast.walk(ast.parse(text))]
    docs = sum(isinstance(n, ast.Expr) and isinstance(getattr(n.value, "value", 0), str) for n in nodes)
    return [sum(isinstance(n, ast.stmt) for n in nodes) - docs, sum(isinstance(n, ast.expr) for n in nodes)]


limits = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["ratchet"]
folders = {path.name: path for path in sorted(PACKAGE.iterdir()) if any(path.glob("*.py"))}
sizes = {name: size(path) for name, path in {"package": PACKAGE, "tests": ROOT / "tests", **folders}.items()}
print("[tool.ratchet]", *(f"{name} = {value}" for name, value in sizes.items()), sep="\n")
over = [
    name for name in sizes if any(now > most for now, most in zip(sizes[name], limits[name], strict=True))
]
sys.exit(f"too large: {', '.join(over)}" if over else 0)
