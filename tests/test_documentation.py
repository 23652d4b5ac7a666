"""Pages are package docstrings: their code runs, their links lead somewhere."""

import ast
import builtins
import doctest
import importlib
import inspect
import os
import pkgutil
import re
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

import aprjax

README = (Path(__file__).resolve().parents[1] / "README.md").read_text()
PAGES = ["aprjax", "aprjax.compilation", "aprjax.evaluation", "aprjax.plot"]


@pytest.mark.parametrize("name", PAGES)
def test_the_code_of_a_page_prints_what_it_says(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    page = importlib.import_module(name)
    (test,) = [
        test for test in doctest.DocTestFinder(recurse=False).find(page, name) if test.name == name
    ]
    assert test.examples
    report: list[str] = []
    doctest.DocTestRunner().run(test, out=report.append)
    assert not report, "".join(report)


@pytest.fixture(scope="module")
def documented():
    """All documented things of the API reference, by their full names."""
    doc = pytest.importorskip("pdoc.doc")
    found = {}

    def collect(thing):
        found[thing.fullname] = thing
        for member in getattr(thing, "members", {}).values():
            if member.fullname not in found:
                collect(member)

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for module in pkgutil.walk_packages(aprjax.__path__, "aprjax."):
            if not module.name.startswith("aprjax.cli"):
                collect(doc.Module.from_name(module.name))
        collect(doc.Module.from_name("aprjax"))
    return found


def test_every_public_name_is_in_the_reference_with_a_docstring(documented):
    for name in aprjax.__all__:
        assert documented[f"aprjax.{name}"].docstring, name


def test_every_link_in_a_docstring_leads_somewhere(documented):
    broken = {
        (name, link)
        for name, thing in documented.items()
        if name.startswith("aprjax.") or name == "aprjax"
        for link in re.findall(r"`(aprjax(?:\.\w+)+)`", thing.docstring)
        if link not in documented
    }
    assert not broken


def test_the_signatures_of_the_reference_are_understood(documented):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for name, thing in documented.items():
            if inspect.isfunction(getattr(thing, "obj", None)) and name.startswith("aprjax."):
                assert thing.signature is not None


def names_of(source):
    """Dotted names of the package that a source text uses, and those that it imports."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Attribute) and ast.unparse(node).startswith("aprjax."):
            yield re.match(r"[\w.]+", ast.unparse(node))[0]
        elif isinstance(node, ast.ImportFrom) and node.module.split(".")[0] == "aprjax":
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def test_the_files_and_experiments_that_the_readme_names_are_there():
    root = Path(__file__).resolve().parents[1]
    files = re.findall(r"(?:experiments|benchmarks)/[\w/-]+\.\w+", README)
    modules = re.findall(r"python -m experiments\.(\w+)", README)
    assert len(files) > 10
    assert len(modules) > 10
    named = {*files, *(f"experiments/{module}.py" for module in modules)}
    assert {name for name in named if not (root / name).is_file()} == set()


def test_what_the_readme_uses_is_there():
    used = {
        name
        for block in re.findall(r"^```python\n(.*?)^```$", README, re.MULTILINE | re.DOTALL)
        for name in names_of(block)
    }
    assert {"aprjax.match", "aprjax.ReferenceSet.build"} <= used
    for name in used:
        assert pkgutil.resolve_name(name) is not None


def test_what_a_block_of_the_readme_names_was_imported_or_made_before():
    known = {*dir(builtins), "ranges", "image", "images"}  # what a robot's sensors give
    for block in re.findall(r"^```python\n(.*?)^```$", README, re.MULTILINE | re.DOTALL):
        used = set()
        for node in ast.walk(ast.parse(block)):
            if isinstance(node, ast.Name):
                (used if isinstance(node.ctx, ast.Load) else known).add(node.id)
            elif isinstance(node, ast.alias):
                known.add((node.asname or node.name).split(".")[0])
            elif isinstance(node, ast.FunctionDef | ast.ClassDef):
                known.add(node.name)
            elif isinstance(node, ast.arg):
                known.add(node.arg)
        assert used <= known, block


def test_the_readmes_command_for_the_reference_works_where_matplotlib_never_ran(tmp_path):
    pytest.importorskip("pdoc")
    (variable, options) = re.search(r"(PDOC_ALLOW_EXEC)=1 \S+ (-W error -m pdoc) ", README).groups()
    done = subprocess.run(
        [sys.executable, *options.split(), "-o", tmp_path / "api", "aprjax.explanation.html"],
        env={**os.environ, variable: "1", "MPLCONFIGDIR": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "api" / "aprjax" / "explanation" / "html.html").is_file()
