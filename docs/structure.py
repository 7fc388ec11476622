"""Draw the packages and their imports, counted, into both pages `architecture.md`: ``python -m docs.structure``."""

import ast
from collections import Counter
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


def imports_by_package() -> dict[str, Counter[str]]:
    """Count, for each package, the import statements that name each other package."""
    counts: dict[str, Counter[str]] = {}
    for file in sorted(PACKAGE.rglob("*.py")):
        package = package_of(".".join(file.relative_to(ROOT).with_suffix("").parts))
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("simrob_drake."):
                other = package_of(str(node.module))
                if other and other != package:
                    counts.setdefault(package, Counter())[other] += 1
    return counts


def drawing() -> str:
    """Draw who imports what: one line for each package, with the number of import statements in brackets."""
    counts = imports_by_package()
    extensions = sorted(package for package in counts if package.startswith("extensions/"))
    lines = ["core"]
    lines += [_line(package, counts.get(package, Counter())) for package in CORE]
    lines += ["", "extensions"]
    lines += [_line(package, counts[package]) for package in extensions]
    return "\n".join(lines)


def _line(package: str, counts: Counter[str]) -> str:
    """One line of the drawing: a package and the packages that it imports, the most frequent first."""
    others = ", ".join(f"{other.removeprefix('extensions/')} ({count})" for other, count in counts.most_common())
    name = package.removeprefix("extensions/")
    return f"  {name:<11}<- {others}" if others else f"  {name}"


def renewed(page: str) -> str:
    """Return the text of the page with the drawing of today."""
    before, _, rest = page.partition(BEGIN)
    _, _, after = rest.partition(END)
    return f"{before}{BEGIN}\n\n```text\n{drawing()}\n```\n\n{END}{after}"


if __name__ == "__main__":
    for page in PAGES:
        page.write_text(renewed(page.read_text(encoding="utf-8")), encoding="utf-8")
        print(page)
