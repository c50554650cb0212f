"""What the documents say is so: the README's example runs, its commands exist, the reference is up to date."""

from __future__ import annotations

import re
import runpy
import shlex
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def blocks(language: str, document: str = "README.md") -> list[str]:
    text = (ROOT / document).read_text(encoding="utf-8")
    return re.findall(rf"```{language}\n(.*?)```", text, flags=re.DOTALL)


def test_the_python_examples_of_the_readme_run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for example in blocks("python"):
        assert len([line for line in example.splitlines() if line.strip()]) <= 11
        exec(compile(example, "README.md", "exec"), {})  # noqa: S102  (our own document)
    told = capsys.readouterr().out
    assert "strategy.name" in told
    assert "consensus" in told
    assert "robots never decided" in told
    assert (tmp_path / "beliefs.csv").stat().st_size > 1000


def test_the_example_of_the_pictures_runs_and_all_are_named(tmp_path, monkeypatch):
    from vibroswarm import plots

    (example,) = blocks("python", "docs/pictures.md")
    monkeypatch.chdir(tmp_path)
    exec(compile(example, "pictures.md", "exec"), {})  # noqa: S102  (our own document)
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        *(f"outcomes.{kind}" for kind in ("csv", "pdf", "png", "svg")),
        "report.html",
    ]
    text = (ROOT / "docs" / "pictures.md").read_text(encoding="utf-8")
    for name in plots.__all__:
        assert f"`{name}" in text, name


def test_the_commands_of_the_readme_are_understood():
    from vibroswarm.cli import parser

    lines = [line.split("#")[0].strip() for block in blocks("sh") for line in block.splitlines()]
    commands = [shlex.split(line)[1:] for line in lines if re.match(r"(\S*/)?vibroswarm ", line)]
    assert len(commands) >= 5
    for command in commands:
        assert parser().parse_args(command).command is not None


def test_the_public_names_are_there():
    import vibroswarm

    for name in vibroswarm.__all__:
        assert getattr(vibroswarm, name) is not None
    with pytest.raises(AttributeError):
        vibroswarm.nothing  # noqa: B018


@pytest.mark.parametrize("name", ["make_reference", "make_commands"])
def test_what_is_made_from_the_sources_is_up_to_date(name):
    made = runpy.run_path(str(ROOT / "docs" / f"{name}.py"))
    assert made["TARGET"].read_text(encoding="utf-8") == made["reference"](), (
        f"python docs/{name}.py makes it again"
    )


def test_links_between_documents_lead_somewhere():
    for document in [*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")]:
        for target in re.findall(r"\]\(([^)#:]+)\)", document.read_text(encoding="utf-8")):
            assert (document.parent / target).exists(), f"{document.name} links to {target}"
