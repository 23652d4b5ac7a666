"""A module imports only from entries above its own, and importing the package does no work."""

import ast
import json
import subprocess
import sys
from pathlib import Path

import pytest

import aprjax

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = Path(aprjax.__file__).parent

# The entries of aprjax in their order; `aprjax` itself, the public names, is for the command
# line alone.
ORDER = [
    "configuration",
    "numerics",
    "se2",
    "plane",
    "status",
    "atomic",
    "packing",
    "scan",
    "sim",
    "anchors",
    "relations",
    "alignment",
    "evaluation",
    "refine",
    "programs",
    "calls",
    "features",
    "describing",
    "shortlist",
    "grid",
    "references",
    "result",
    "matcher",
    "batch",
    "compilation",
    "sharding",
    "catalogue",
    "sweeping",
    "metrics",
    "io",
    "places",
    "world",
    "tracking",
    "plot",
    "explanation",
    "contract",
    "aprjax",
    "cli",
]
MODULES = sorted(path for path in PACKAGE.rglob("*.py") if path != PACKAGE / "__init__.py")


def entry_of(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imported_entries(source: str, package: tuple[str, ...]) -> set[str]:
    """Entries that a source text in `package` imports from, wherever in it the import stands."""
    names = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) - node.level + 1] if node.level else ()
            module = ".".join([*above, *([node.module] if node.module else [])])
            if module == "aprjax":  # may name an entry, or a public name
                names |= {f"{module}.{alias.name}" for alias in node.names}
            else:
                names.add(module)
    parts = [name.split(".") for name in names]
    return {
        name[1] if len(name) > 1 and name[1] in ORDER else "aprjax"
        for name in parts
        if name[0] == "aprjax"
    }


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_a_module_imports_only_from_entries_above_its_own(path):
    own = entry_of(path)
    assert own in ORDER, f"{own} has no place in the order of the entries"
    package = ("aprjax", *path.relative_to(PACKAGE).parts[:-1])
    allowed = {*ORDER[: ORDER.index(own)], own}
    assert imported_entries(path.read_text(), package) <= allowed


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_the_engine_knows_nothing_of_the_simulator(path):
    engine = ORDER[ORDER.index("anchors") : ORDER.index("metrics")]
    package = ("aprjax", *path.relative_to(PACKAGE).parts[:-1])
    if entry_of(path) in engine:
        assert "sim" not in imported_entries(path.read_text(), package)


@pytest.mark.parametrize(
    ("source", "entries"),
    [
        ("import aprjax.io.carmen", {"io"}),
        ("import numpy, aprjax.scan as s", {"scan"}),
        ("from aprjax.cli.main import main", {"cli"}),
        ("from aprjax import se2", {"se2"}),
        ("from aprjax import ReferenceSet", {"aprjax"}),
        ("import aprjax", {"aprjax"}),
        ("from .segment import segment", {"anchors"}),
        ("from ..scan import Scan", {"scan"}),
        ("from .. import matcher", {"matcher"}),
        ("def f():\n    from aprjax.plot import draw", {"plot"}),
        ("import jax\nfrom numpy import array", set()),
    ],
)
def test_every_form_of_import_is_seen(source, entries):
    assert imported_entries(source, ("aprjax", "anchors")) == entries


def test_the_public_names_are_all_that_the_package_file_holds():
    tree = ast.parse((PACKAGE / "__init__.py").read_text())
    docstring, *imports, listed = tree.body
    assert isinstance(docstring, ast.Expr)
    assert isinstance(docstring.value, ast.Constant)
    names = set()
    for node in imports:
        assert isinstance(node, ast.ImportFrom), ast.unparse(node)
        names |= {alias.asname for alias in node.names}
    assert isinstance(listed, ast.Assign)
    assert ast.unparse(listed.targets[0]) == "__all__"
    # And the entries, which the API reference would else leave out.
    entries = {entry_of(path) for path in MODULES} - {"cli"}
    assert set(ast.literal_eval(listed.value)) == names | entries


IMPORT = """
import json, jax
before = dict(jax.config.values)
import aprjax
changed = sorted(k for k, v in jax.config.values.items() if k not in before or before[k] != v)
from jax._src import xla_bridge
print(json.dumps({"changed": changed, "backends": sorted(xla_bridge._backends)}))
"""


def test_importing_compiles_nothing_and_changes_no_setting_of_jax():
    run = subprocess.run(
        [sys.executable, "-W", "error:::aprjax", "-c", IMPORT],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    assert json.loads(run.stdout) == {"changed": [], "backends": []}
