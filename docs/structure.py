"""Draw the packages and what they import into both pages `architecture.md`: ``python -m docs.structure``."""

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "simrob_drake"
PAGES = (ROOT / "docs" / "architecture.md", ROOT / "docs" / "es" / "architecture.md")
BEGIN = "<!-- made by docs/structure.py: begin -->"
END = "<!-- made by docs/structure.py: end -->"
CORE = (
    "base",
    "robots",
    "importer",
    "dynamics",
    "blocks",
    "walking",
    "parts",
    "stations",
    "results",
    "simulation",
    "kinematics",
    "programs",
    "cli",
)
"""Packages of the core, in the order of their imports."""


def package_of(module: str) -> str:
    """Return the package of a module: ``robots``, ``cli``, or ``extensions/rapid``; empty for the top level."""
    parts = module.split(".")[1:]
    if not parts:
        return ""
    return f"extensions/{parts[1]}" if parts[0] == "extensions" and len(parts) > 1 else parts[0]


def import_statements(tree: ast.Module) -> Iterator[ast.Import | ast.ImportFrom]:
    """Yield all import statements of a module, those in functions and conditions included.

    Only statements are visited. Expressions, which are most of a tree, contain none: this is ten times as fast as
    ``ast.walk``.
    """
    statements: list[ast.AST] = list(tree.body)
    while statements:
        node = statements.pop()
        if isinstance(node, ast.Import | ast.ImportFrom):
            yield node
        for blocks in ("body", "orelse", "finalbody", "handlers", "cases"):
            block = getattr(node, blocks, None)
            # The body of a lambda or of a conditional expression is no list of statements.
            if isinstance(block, list):
                statements += block


@cache
def imports_by_package() -> dict[str, set[str]]:
    """Collect, for each package, the other packages that its modules import."""
    imports: dict[str, set[str]] = {}
    for file in sorted(PACKAGE.rglob("*.py")):
        package = package_of(".".join(file.relative_to(ROOT).with_suffix("").parts))
        for node in import_statements(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("simrob_drake."):
                other = package_of(str(node.module))
                if other and other != package:
                    imports.setdefault(package, set()).add(other)
    return imports


def drawing() -> str:
    """Draw which package imports which, one line for each package."""
    imports = imports_by_package()
    extensions = sorted(package for package in imports if package.startswith("extensions/"))
    lines = ["core"]
    lines += [_line(package, imports.get(package, set())) for package in CORE]
    lines += ["", "extensions"]
    lines += [_line(package, imports[package]) for package in extensions]
    return "\n".join(lines)


def _line(package: str, imported: set[str]) -> str:
    """One line of the drawing: a package and the packages that it imports, in the order of the core."""
    names = [other for other in CORE if other in imported]
    names += sorted(other.removeprefix("extensions/") for other in imported - set(CORE))
    name = package.removeprefix("extensions/")
    return f"  {name:<11}<- {', '.join(names)}" if names else f"  {name}"


def renewed(page: str) -> str:
    """Return the text of the page with the drawing of today."""
    before, _, rest = page.partition(BEGIN)
    _, _, after = rest.partition(END)
    return f"{before}{BEGIN}\n\n```text\n{drawing()}\n```\n\n{END}{after}"


if __name__ == "__main__":
    for page in PAGES:
        page.write_text(renewed(page.read_text(encoding="utf-8")), encoding="utf-8")
        print(page)
