"""A program as a Python script that runs by itself."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from pprint import pformat
from typing import Any

from simrob_drake.programs.program import Program

_WIDTH = 100
_NESTED = " " * 8


def script(
    program: Program,
    station: str,
    settings: Mapping[str, Any],
    *,
    robot: str | None,
    legs: bool,
    code: bool,
    file: Path,
) -> str:
    """Return the text of a script that runs a program, and saves all of it as one result.

    ``station`` is a name, or a file, which goes with a script in its folder; ``code``: whether it names Python code.
    """
    near = Path(station).parent == file.parent
    place = f'Path(__file__).with_name("{Path(station).name}")' if near else _value(station)
    names = ["LeggedRobot" if legs else "Workcell", "Program", "load_station"]
    imports = ["from pathlib import Path\n"] * near + [
        f"from simrob_drake import {', '.join(sorted(names))}"
    ]
    whose = f", {_value(robot)}" if robot else ""
    run = (
        f"robot = LeggedRobot(station{whose})\nrobot.run(program)\nresult = robot.result()"
        if legs
        else "result = Workcell(station).perform(program)"
    )
    content = program.model_dump(mode="json", exclude={"station"}, exclude_defaults=True)
    changed = f", {_value(dict(settings))}" if settings else ""
    parts = [
        f'"""{program.description or "A program that was taught"}; its signals are in {file.stem}-run/signals.csv."""',
        "\n".join(imports),
        f"station = load_station({place}{changed}{', allow_code=True' * code})",
        f"program = Program(\n{''.join(_argument(key, value) for key, value in content.items())})",
        f'{run}\nprint(result)\nresult.save("{file.stem}-run", force=True)\n',
    ]
    return "\n\n".join(parts)


def _argument(key: str, value: Any) -> str:
    if not isinstance(value, Sequence) or isinstance(value, str):
        return f"    {key}={_value(value)},\n"
    entries = "".join(
        f"{_NESTED}{_value(entry)},\n".replace("\n ", f"\n{_NESTED} ") for entry in value
    )
    return f"    {key}=[\n{entries}    ],\n"


def _value(value: Any) -> str:
    text = pformat(value, width=_WIDTH, sort_dicts=False, compact=True)
    return text if '"' in text else text.replace("'", '"')
