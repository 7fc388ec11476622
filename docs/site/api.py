"""The Python API, from docstrings: what the package shows, what the pages and examples import, and the blocks."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from pkgutil import iter_modules

import simrob_drake
import simrob_drake.blocks
from docs.site.texts import Page, sentence, table

ROOT = Path(__file__).parents[2]
FOLDER = "reference"
GROUPS = {
    "Stations": ["load_station", "station_names", "StationConfig", "Station", "build_station", "add_station",
                 "StationPorts", "apply_solver"],
    "Runs": ["simulate", "simulate_diagram", "Runner", "RunBranch", "SimulationResult", "State", "FailedRunWarning"],
    "Saved results": ["load_result", "SavedResult", "plot_results"],
    "Programs": ["Arm", "Workcell", "LeggedRobot", "Program"],
    "A plant of your own": [
        "add_world", "place_station", "PlacedStation", "add_joint_servos", "JointServos", "Motor", "add_monitor",
        "add_joint_limit_monitor", "add_contact_sensor", "add_imu", "build_hardware_station", "HardwareStation",
    ],
    "Models": ["Dynamics", "LinearModel", "linearize"],
    "Frames and errors": ["as_transform", "three_point_frame", "SimrobError"],
    "Extensions": ["Extension"],
}  # fmt: skip
"""What the package shows at its top, in the order in which one meets it."""


def exported(file: Path, package: str) -> dict[str, str]:
    """Return the module of each name that the ``__init__`` of a package takes from its modules."""
    return {
        name.name: f"{package}.{node.module}" if node.level else str(node.module)
        for node in ast.parse(file.read_text(encoding="utf-8")).body
        if isinstance(node, ast.ImportFrom) and (node.level or (node.module or "").startswith(package))
        for name in node.names
    }


def places() -> dict[str, str]:
    """Return the module, below the package, of each name that the package shows."""
    return exported(Path(simrob_drake.__file__).with_suffix(".pyi"), "simrob_drake")


def named() -> Iterator[tuple[str, str]]:
    """Yield module and name of what the text of pages names with its module; of a package all that it shows."""
    for page in [*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")]:
        for dotted in re.findall(r"`(simrob_drake(?:\.\w+)+)", page.read_text(encoding="utf-8")):
            place = ROOT.joinpath(*dotted.split("."))
            if (place / "__init__.py").is_file():
                yield from ((module, name) for name, module in exported(place / "__init__.py", dotted).items())
            elif place.parent.with_suffix(".py").is_file():
                yield dotted.rpartition(".")[0], place.name


def _scripts() -> Iterator[str]:
    for page in [*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")]:
        yield from re.findall(r"^```python\n(.*?)^```", page.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
    for example in ROOT.glob("examples/**/*.py"):
        yield example.read_text(encoding="utf-8")


def further() -> dict[str, list[str]]:
    """Return by module what pages and examples import or name from beyond the package's top."""
    found: dict[str, set[str]] = {}
    for module, name in named():
        found.setdefault(module, set()).add(name)
    for script in _scripts():
        for node in ast.walk(ast.parse(script)):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("simrob_drake."):
                found.setdefault(str(node.module), set()).update(name.name for name in node.names)
    shown = set(places())
    return {
        module: sorted(names - shown)
        for module, names in sorted(found.items())
        if names - shown and not module.startswith("simrob_drake.blocks.")
    }


def documented(identifier: str, *, level: int = 1, more: str = "inherited_members") -> str:
    """Return what makes mkdocstrings show an object below a heading of a level, with one more of its options."""
    return f"::: {identifier}\n    options:\n      heading_level: {level}\n      {more}: true\n"


def name_page(name: str, module: str) -> Page:
    """Return the page of one name of the package."""
    return Page(f"{FOLDER}/python/{name}.md", f"---\ntitle: {name}\n---\n\n{documented(f'{module}.{name}')}")


def block_pages() -> Iterator[Page]:
    """Yield the page of each module of blocks, and their list."""
    rows = []
    for module in iter_modules(simrob_drake.blocks.__path__):
        name = module.name
        source = Path(simrob_drake.blocks.__path__[0], f"{name}.py").read_text(encoding="utf-8")
        rows.append([f"[`{name}`]({name}.md)", sentence(ast.get_docstring(ast.parse(source)) or "")])
        shown = documented(f"simrob_drake.blocks.{name}")
        yield Page(f"{FOLDER}/blocks/{name}.md", f"---\ntitle: {name}\n---\n\n{shown}")
    intro = "Blocks are plain Drake systems, or functions that add some to a builder; they know nothing of stations."
    yield Page(
        f"{FOLDER}/blocks/index.md",
        f"# Blocks\n\n{intro}\n\n{table(['module', 'what it holds'], rows)}",
    )


def pages() -> Iterator[Page]:
    """Yield the pages of the API, and the list of it."""
    where = places()
    assert sorted(where) == sorted(name for names in GROUPS.values() for name in names), "GROUPS lacks a public name"
    parts = [
        "# Python",
        "What `import simrob_drake` shows; anything else may change from one version to the next.",
    ]
    for title, names in GROUPS.items():
        rows = [[f"[`{name}`]({name}.md)", sentence(getattr(simrob_drake, name).__doc__)] for name in names]
        parts += [f"## {title}", table(["name", "what it is"], rows)]
        for name in names:
            yield name_page(name, where[name])
    yield Page(f"{FOLDER}/python/index.md", "\n\n".join(parts) + "\n")
    found = [f"{module}.{name}" for module, names in further().items() for name in names]
    modules = "\n".join(documented(name, level=2, more="show_root_full_path") for name in found)
    yield Page(
        f"{FOLDER}/modules.md",
        f"# More modules\n\nWhat pages and examples import or name besides.\n\n{modules}",
    )
    yield from block_pages()
