"""Write results/verdicts.md, the verdicts of the stations of the package: ``python docs/verdicts.py`` renews it."""

from pathlib import Path
from typing import Any

from simrob_drake import SimulationResult, load_station, station_names
from simrob_drake.programs.whole_program import run_whole
from simrob_drake.results.verdict.words import in_words

DOCS = Path(__file__).parent
COLUMNS = {
    "final_error": "final error",
    "largest_error": "largest error",
    "torque_share": "torque",
    "torque_time": "at its limit",
    "speed_share": "speed",
    "penetration": "penetration",
    "foot_slip": "slip",
    "shortened_steps": "solver retries",
}
"""The measures that are shown, and their headings."""
HEADING = """# Verdicts

How a run of each station of the package ends as it is, `simrob run STATION`: the worst of all its axes, bodies and
feet. [Stations](../stations.md#verdict) says what the measures mean and how a station sets its bounds.
`python docs/verdicts.py` writes this page.
"""
BOARD = {"parent": "world", "pose": [-0.2, -0.2, 0.1, 0, 0, 0]}
BOX = {"model": "box_on_corners", "free": True, "pose": [0, 0, 0.201, 0, 0, 0]}
SPOILT: dict[str, tuple[str, dict[str, Any]]] = {
    "a motor too weak for its move": (
        "irb120_dynamic",
        {"servo.torque_limit": {"joint_2": 2}, "reference.target_deg": {"joint_2": 50}},
    ),
    "a move in too short a time": (
        "irb120_kinematic",
        {"reference.duration": 0.1, "duration": 0.2},
    ),
    "an arm that stands too low": (
        "irb120_kinematic",
        {"robot.base": [0, 0, -0.83, 0, 0, 0], "reference": {"kind": "hold"}, "duration": 0.1},
    ),
    "a box on a soft board": (
        "box_on_floor",
        {"pieces": {"board": BOARD, "box": BOX}, "contact.stiffness": 500, "sensors": {}},
    ),
}
"""Stations that are made to go wrong: which, and what is changed."""
SPOILT_HEADING = """
## Runs that go wrong

Shipped stations, changed so that they cannot do what is asked; each ran to its end, and none is silent.
"""
BEFORE = """
## What is said before and while it runs

* A piece that is not free and names no parent is refused, with what it could hang on; `simrob check` lists where each
  piece hangs.
* A first station (`simrob station FILE`) is kept from floor and self, stands on the ends of its legs, and ends at a
  fall; where no such posture is found, the file and the screen say what it lacks ([Robots](../robots.md)).
* A run that makes less than 0.02 × real time for 5 s says which part holds it up and what to set, as of a parcel that
  is let go on a pallet under `radau3`: the contact of the two, and `solver.scheme=cenic`.
"""


def row(name: str, result: SimulationResult) -> list[str]:
    """Return the cells of a run: what it is called, its measures, and those that pass their bounds."""
    found = {measure.criterion.name: measure.worst for measure in result.verdict.measures}
    cells = [in_words(found[name].value, found[name].unit) if name in found else "–" for name in COLUMNS]
    return [name, *cells, ", ".join(result.verdict.beyond) or "–"]


def section(first: str, results: dict[str, SimulationResult]) -> list[str]:
    """Return the lines of a table of runs, and below it what the warnings say."""
    table = [[first, *COLUMNS.values(), "beyond its bound"], ["---"] * (len(COLUMNS) + 2)]
    table += [row(name, result) for name, result in results.items()]
    warnings = [f"- {name}: {warning}." for name, result in results.items() for warning in result.warnings]
    return [
        *(f"| {' | '.join(cells)} |" for cells in table),
        "",
        "The warnings in words:",
        "",
        *warnings,
    ]


def page() -> str:
    """Run all, and return the page."""
    shipped = {f"`{name}`": run_whole(load_station(name)) for name in station_names()}
    spoilt = {f"{what} (`{name}`)": run_whole(load_station(name, how)) for what, (name, how) in SPOILT.items()}
    return "\n".join([HEADING, *section("station", shipped), SPOILT_HEADING, *section("run", spoilt), BEFORE])


if __name__ == "__main__":
    (DOCS / "results" / "verdicts.md").write_text(page(), encoding="utf-8")
