"""Digests of every signal of all stations, walks and programs: ``python -m tests.digests FILE [--against OLD]``.

For a change that must not change what happens: make the list before it, make it again after it, on the same machine,
and let the second call compare. Two columns are equal if their numbers are, to the last bit. Columns that a change
renamed are named by ``--renamed OLD=NEW``. It takes some minutes; ``--only TEXT`` takes cases with that text in their
names.
"""

from __future__ import annotations

import argparse
import hashlib
import json
from collections.abc import Callable
from pathlib import Path

from simrob_drake import (
    LeggedRobot,
    Program,
    SimulationResult,
    Workcell,
    load_station,
    simulate,
    station_names,
)
from simrob_drake.programs.whole_program import perform

ROOT = Path(__file__).parents[1]
WALKS = ("humanoid_dynamic", "roid1_dynamic", "zjudancer_dynamic", "yobotics_dynamic")
GOING = ("zjudancer_walking", "roid1_walking", "humanoid_walking", "yobotics_walking")
LONGEST = 6.0  # s of a station's run

Digests = dict[str, dict[str, str]]


def cases() -> dict[str, Callable[[], SimulationResult]]:
    """Return what is run, by name."""
    found: dict[str, Callable[[], SimulationResult]] = {}
    for name in station_names():
        found[f"station {name}"] = lambda name=name: _run(name)
    for name in WALKS:
        found[f"walk {name}"] = lambda name=name: LeggedRobot(name).walk(2)
    for name in GOING:
        found[f"go {name}"] = lambda name=name: LeggedRobot(name).go(
            ahead=0.1, turn=0.1, duration=3.0
        )
    for file in sorted((ROOT / "examples").glob("*.yaml")):
        found[f"program {file.name}"] = lambda file=file: _performed(file)
    return found


def _run(name: str) -> SimulationResult:
    config = load_station(name)
    return simulate(config, duration=min(config.duration, LONGEST), progress=False)


def _performed(file: Path) -> SimulationResult:
    program = Program.load(file)
    return perform(Workcell(program.station), program, str(file))


def digest(result: SimulationResult) -> dict[str, str]:
    """Return how a run ended, and a digest of each of its columns."""
    columns = {
        name: hashlib.sha256(result[name].tobytes()).hexdigest()[:16] for name in result.names
    }
    return {"ending": f"{result.ending} at {result.stop_time!r} s", **columns}


def differences(old: Digests, new: Digests, renamed: dict[str, str]) -> list[str]:
    """Return, in words, which cases and columns differ."""
    lines = [
        f"{case}: only {'before' if case in old else 'after'}"
        for case in sorted(old.keys() ^ new.keys())
    ]
    for case in sorted(old.keys() & new.keys()):
        before = {renamed.get(name, name): value for name, value in old[case].items()}
        after = new[case]
        changed = sorted(
            name for name in before.keys() & after.keys() if before[name] != after[name]
        )
        lost, more = sorted(before.keys() - after.keys()), sorted(after.keys() - before.keys())
        for names, what in ((changed, "other numbers"), (lost, "no longer there"), (more, "new")):
            if names:
                lines.append(f"{case}: {len(names)} columns {what}: {', '.join(names[:5])}")
    return lines


def main() -> int:
    """Make a list, and compare it with another one."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("file", type=Path, help="where the list is written, as JSON")
    parser.add_argument("--against", type=Path, help="a list made before")
    parser.add_argument(
        "--renamed", action="append", default=[], metavar="OLD=NEW", help="a column's two names"
    )
    parser.add_argument(
        "--only", default="", metavar="TEXT", help="only cases whose names hold this text"
    )
    options = parser.parse_args()
    made: Digests = {}
    for name, run in cases().items():
        if options.only in name:
            print(name, flush=True)
            made[name] = digest(run())
            options.file.write_text(json.dumps(made, indent=1))
    if options.against is None:
        return 0
    old = {
        case: found
        for case, found in json.loads(options.against.read_text()).items()
        if options.only in case
    }
    lines = differences(old, made, dict(pair.split("=", 1) for pair in options.renamed))
    print("\n".join(lines) or f"{len(made)} cases are equal to the last bit")
    return 1 if lines else 0


if __name__ == "__main__":
    raise SystemExit(main())
