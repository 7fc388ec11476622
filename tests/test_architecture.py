"""The structure: imports point one way, the core imports no extension, and nothing heavy is imported on the way."""

import ast
import subprocess
import sys
from functools import cache
from graphlib import CycleError, TopologicalSorter
from importlib import import_module
from pathlib import Path

import pytest

import simrob_drake
from docs import structure

PACKAGE = Path(simrob_drake.__file__).parent
CORE = structure.CORE
"""Packages of the core, in the order of their imports."""
EXTENSIONS = [
    "mujoco",
    "drake_scenes",
    "linear",
    "rapid",
    "simulink",
    "comparison",
    "tuning",
    "legged",
    "learning",
    "pendant",
    "course",
]
"""Our own extensions, in the order of their imports."""
ORDER = [*CORE, *EXTENSIONS]
ROOT = {"former_names"}
"""Modules of the top level that import nothing of the package."""
MODULES = sorted(file for file in PACKAGE.rglob("*.py") if file.name != "__init__.py")


@cache
def parsed(file: Path) -> ast.Module:
    return ast.parse(file.read_text())


def package_of(module: str) -> str:
    """Return the package of a module: ``robots`` of ``simrob_drake.robots.urdf``, ``rapid`` of an extension's."""
    parts = module.split(".")[1:]
    if not parts or parts[0] in ROOT:
        return "base"
    return parts[1] if parts[0] == "extensions" and len(parts) > 1 else parts[0]


def place(module: str) -> int:
    """Return the position of a module's package in the order of imports."""
    package = package_of(module)
    return 0 if package == "extensions" else ORDER.index(package)


@cache
def imported(file: Path) -> set[str]:
    nodes = list(structure.import_statements(parsed(file)))
    froms = {node.module for node in nodes if isinstance(node, ast.ImportFrom) and node.module}
    plain = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    return froms | plain


def module_of(file: Path) -> str:
    """Return the dotted name of a module."""
    return ".".join(file.relative_to(PACKAGE.parent).with_suffix("").parts)


def test_imports_point_to_the_left():
    names = {module_of(file): file for file in MODULES}
    pairs = [(name, other) for name, file in names.items() for other in imported(file)]

    own = [(name, other) for name, other in pairs if other.startswith("simrob_drake.")]
    assert [f"{name} imports {other}" for name, other in own if place(other) > place(name)] == []
    assert len(own) > 1000
    assert [name for name, other in pairs if other == "pydrake.all"] == [], (
        "it shadows builtins and loads everything"
    )


def test_the_page_of_the_architecture_shows_the_imports_of_today():
    for file in structure.PAGES:
        page = file.read_text(encoding="utf-8")
        assert structure.renewed(page) == page, "run python -m docs.structure"
    assert tuple(CORE) == structure.CORE


def test_the_core_imports_no_extension():
    """Imports in functions, those for types alone, and names of modules in strings are counted, too."""
    found = []
    for file in MODULES:
        module = module_of(file)
        if package_of(module) not in CORE or module == "simrob_drake.former_names":
            continue
        texts = {node.value for node in ast.walk(parsed(file)) if isinstance(node, ast.Constant)}
        named = {text for text in texts if isinstance(text, str)} | imported(file)
        found += [
            f"{module} names {name}"
            for name in named
            if name.startswith("simrob_drake.extensions.")
        ]
    assert found == []


def extension_of(module: str) -> str:
    """Return the name of the extension that a module belongs to; empty for a module of the core."""
    parts = module.split(".")
    return parts[2] if parts[:2] == ["simrob_drake", "extensions"] and len(parts) > 2 else ""


def test_an_extension_imports_only_the_extensions_that_it_declares():
    found = []
    for file in MODULES:
        own = extension_of(module_of(file))
        if not own:
            continue
        announced = import_module(f"simrob_drake.extensions.{own}.extension").EXTENSION
        others = {extension_of(name) for name in imported(file)} - {"", own}
        missing = others - {*announced.needs, *announced.uses}
        found += [
            f"{module_of(file)} imports {other}, which {own} does not declare"
            for other in sorted(missing)
        ]
    assert found == []


PUBLIC_UNDERSCORES = {"_replace", "_asdict", "_fields", "_exit"}
"""Public names of the standard library that begin with an underscore: of named tuples, and of `os`."""


def is_private(name: str) -> bool:
    return name.startswith("_") and not name.startswith("__") and name not in PUBLIC_UNDERSCORES


def names_defined(tree: ast.Module) -> set[str]:
    """Return all names that a module defines or assigns: of functions, classes, variables and attributes."""
    nodes = list(ast.walk(tree))
    defined = {
        node.name
        for node in nodes
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef)
    }
    stored = [node for node in nodes if isinstance(getattr(node, "ctx", None), ast.Store)]
    variables = {node.id for node in stored if isinstance(node, ast.Name)}
    return defined | variables | {node.attr for node in stored if isinstance(node, ast.Attribute)}


def private_names_of_others(files: list[Path], own: str) -> list[str]:
    """Find the private names in files of a package ``own`` that the package itself does not define."""
    defined = set().union(*(names_defined(parsed(file)) for file in files))
    found = []
    for file in files:
        for node in ast.walk(parsed(file)):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("simrob_drake"):
                if f"{node.module}.".startswith(f"{own}."):
                    continue
                names = [*str(node.module).split("."), *(alias.name for alias in node.names)]
            elif isinstance(node, ast.Import):
                names = [part for alias in node.names for part in alias.name.split(".")]
            elif isinstance(node, ast.Attribute) and node.attr not in defined:
                names = [node.attr]
            else:
                continue
            found += [f"{file.name}:{node.lineno}: {name}" for name in names if is_private(name)]
    return found


@pytest.mark.parametrize("extension", EXTENSIONS)
def test_an_extension_uses_no_private_name_of_the_core(extension):
    files = [file for file in MODULES if extension_of(module_of(file)) == extension]
    files += [PACKAGE / "extensions" / extension / "__init__.py"]
    assert private_names_of_others(files, f"simrob_drake.extensions.{extension}") == []


@pytest.mark.parametrize(
    ("line", "name"),
    [
        ("from simrob_drake.stations.load import _in_short_form", "_in_short_form"),
        ("from simrob_drake._hidden.load import station", "_hidden"),
        ("import simrob_drake.stations._load", "_load"),
        ("def f(station):\n    return station._builder", "_builder"),
        ("def f(load):\n    load.deep._kept = 1\n    return load._other", "_other"),
    ],
)
def test_a_private_name_of_the_core_is_found(tmp_path, line, name):
    file = tmp_path / "own.py"
    file.write_text(line)
    assert [found.rpartition(": ")[2] for found in private_names_of_others([file], "own")] == [name]


def test_no_modules_need_each_other():
    """Imports in functions, and those for types alone, are counted, too."""
    names = {module_of(file): file for file in MODULES}
    needs = {name: imported(file) & names.keys() for name, file in names.items()}
    try:
        TopologicalSorter(needs).prepare()
    except CycleError as problem:
        pytest.fail(" -> ".join(problem.args[1]))


def test_classes_of_the_package_are_three_deep_at_most():
    """Those of Drake and pydantic, and :class:`Strict`, which only adds checks to pydantic's, are not counted."""
    own = {}
    for file in (file for file in MODULES if "pendant" not in file.parts):
        for node in ast.walk(parsed(file)):
            if isinstance(node, ast.ClassDef):
                names = [
                    base.value if isinstance(base, ast.Subscript) else base for base in node.bases
                ]
                own[node.name] = {base.id for base in names if isinstance(base, ast.Name)} - {
                    node.name,
                    "Strict",
                }

    def depth(name: str) -> int:
        return 1 + max((depth(base) for base in own[name] if base in own), default=0)

    assert {name for name in own if depth(name) > 3} == set()


def test_the_package_loads_nothing_heavy():
    """What draws, solves and reads meshes is loaded where it is first used: `Arm` too."""
    script = (
        "import sys; from simrob_drake import add_station, load_station, simulate; "
        "print([name for name in ('scipy', 'matplotlib', 'trimesh') if name in sys.modules])"
    )
    shown = subprocess.run(
        [sys.executable, "-c", script], check=True, capture_output=True, text=True
    ).stdout

    assert shown.strip() == "[]"
    assert {"Arm", "Workcell"} <= set(dir(simrob_drake))
    assert simrob_drake.Arm.__module__ == "simrob_drake.programs.arm"
    with pytest.raises(AttributeError, match="attribute Amr"):
        _ = simrob_drake.Amr


def test_python_blocks_share_a_base():
    """A solver asks each block for derivatives; Drake's own base makes that dear, see Block."""
    bare = [
        str(file)
        for file in MODULES
        if "(LeafSystem)" in file.read_text() and file.name != "block.py"
    ]
    assert bare == []


@pytest.mark.parametrize("command", ["--help", "--version", "list"])
def test_what_runs_nothing_loads_no_drake(command):
    script = (
        "import sys; from simrob_drake.cli.app import run_command; "
        f"code = run_command([{command!r}]); print(code, 'pydrake' in sys.modules)"
    )
    shown = subprocess.run(
        [sys.executable, "-c", script], check=True, capture_output=True, text=True
    ).stdout
    assert shown.splitlines()[-1] == "0 False"


READERS = {"read_text", "read_bytes", "safe_load", "loadtxt", "genfromtxt"}
"""Functions that read files, or YAML, without the bounds of the border."""
OWN_FILES = {
    "base/messages.py": "its own catalogues, and those of extensions",
    "base/folders.py": "the package's own code, of which a cache's entry is made",
    "cli/command_table.py": "its own code",
    "results/animation/recording.py": "its own script",
    "results/animation/window.py": "its own script",
    "extensions/pendant/pages/shell.py": "its own script and style",
    "extensions/pendant/pages/view.py": "a picture that was just drawn",
}
"""Modules that may call them, and for what."""


def test_files_of_users_are_read_at_the_border():
    """``base.files`` and ``base.yaml_files`` alone read them: they wait for no pipe, and nothing is too large."""
    found = set()
    for file in MODULES:
        module = str(file.relative_to(PACKAGE))
        calls = [node for node in ast.walk(parsed(file)) if isinstance(node, ast.Call)]
        named = {call.func.attr for call in calls if isinstance(call.func, ast.Attribute)}
        opens = [
            call
            for call in calls
            if getattr(call.func, "attr", getattr(call.func, "id", "")) == "open"
        ]
        modes = {arg.value for call in opens for arg in call.args if isinstance(arg, ast.Constant)}
        if named & READERS or modes & {"r", "rb", "rt"}:
            found.add(module)
    assert found == {*OWN_FILES, "base/files.py"}
