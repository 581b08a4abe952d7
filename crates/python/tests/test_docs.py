"""Documentation: every public item has some, help() shows it, and every example in it runs."""

from __future__ import annotations

import doctest
import inspect
import io
import pickle
import pydoc
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import REPOSITORY, recording

import cairn

PACKAGE = REPOSITORY / "crates/python"
CLASSES = [getattr(cairn, name) for name in cairn.__all__ if inspect.isclass(getattr(cairn, name))]
FUNCTIONS = [cairn.open, cairn.load_map]


def members(kind: type) -> Iterator[tuple[str, Any]]:
    return ((name, getattr(kind, name)) for name in vars(kind) if not name.startswith("_"))


@pytest.mark.parametrize("kind", CLASSES, ids=lambda kind: kind.__name__)
def test_every_public_item_is_documented_and_shown_by_help(kind: type) -> None:
    assert kind.__module__ == "cairn" and inspect.getdoc(kind)
    out = io.StringIO()
    pydoc.Helper(output=out).help(kind)
    shown = out.getvalue()
    assert f"class {kind.__name__}" in shown and str(inspect.getdoc(kind)).splitlines()[0] in shown
    for name, member in members(kind):
        words = inspect.getdoc(member)
        assert words, f"{kind.__name__}.{name}"
        assert name in shown and words.splitlines()[0] in shown
        if callable(member):
            assert inspect.signature(member)


def test_names_of_the_package_are_listed() -> None:
    public = {name for name in vars(cairn) if not name.startswith("_")}
    assert public - {"Union"} == set(cairn.__all__) - {"__version__"}
    assert all(inspect.getdoc(function) for function in FUNCTIONS) and cairn.__doc__
    assert pickle.loads(pickle.dumps(cairn.FrameError("why"))).args == ("why",)


def examples() -> Iterator[tuple[str, str]]:
    yield "cairn", str(cairn.__doc__)
    for item in [*CLASSES, *FUNCTIONS]:
        yield item.__name__, item.__doc__ or ""
        if inspect.isclass(item):
            for name, member in members(item):
                yield f"{item.__name__}.{name}", inspect.getdoc(member) or ""
    yield "README.md", (PACKAGE / "README.md").read_text()


@pytest.mark.parametrize(("name", "text"), [e for e in examples() if ">>>" in e[1]], ids=lambda v: v[:40].split("\n")[0])
def test_examples_in_the_documentation_run(name: str, text: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    found = doctest.DocTestParser().get_doctest(inspect.cleandoc(text), {"cairn": cairn, "np": np}, name, name, 0)
    assert found.examples
    flags = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS
    runner = doctest.DocTestRunner(optionflags=flags, verbose=False)
    report = io.StringIO()
    runner.run(found, out=report.write)
    assert runner.failures == 0, report.getvalue()


SCRIPTS = sorted((PACKAGE / "examples").glob("*.py"))


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_examples_run(script: Path, tmp_path: Path) -> None:
    import subprocess
    import sys

    arguments = [str(recording("euroc-mh01")), "60"] if script.stem == "track_euroc" else []
    command = [sys.executable, str(script), *arguments]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=120)
    print(done.stdout)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip()


def test_notebook_runs(tmp_path: Path) -> None:
    nbclient = pytest.importorskip("nbclient")
    nbformat = pytest.importorskip("nbformat")
    pytest.importorskip("ipykernel")
    pytest.importorskip("matplotlib")
    folder = recording("euroc-mh01")
    notebook = nbformat.read(PACKAGE / "examples/euroc.ipynb", as_version=4)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    lines = [line for cell in code for line in cell.source.splitlines() if line.strip()]
    assert len(lines) <= 20, f"{len(lines)} lines"
    # The first 80 frames of the recording that is here.
    code[0].source = code[0].source.replace('cairn.open("euroc-mh01")', f"cairn.open({str(folder)!r}, frames=80)")
    assert str(folder) in code[0].source
    nbclient.NotebookClient(notebook, timeout=120, resources={"metadata": {"path": str(tmp_path)}}).execute()
    outputs = [output for cell in code for output in cell.outputs]
    assert any("image/png" in output.get("data", {}) for output in outputs), "there is a plot"
    text = "".join(output.get("text", "") for output in outputs)
    print(text)
    assert "ATE" in text
