"""A program as a Python script that runs by itself."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from pprint import pformat
from typing import Any

from simrob_drake.programs.program import Program

_WIDTH = 100  # longest line of a value [characters]
_NESTED = " " * 8  # indent of the entries of a list that is an argument


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
    """Write a script that runs a program, and saves all of its runs as one result.

    Args:
        program: the program.
        station: name of the station, or its file. A file in the folder of the script is found relative to the script.
        settings: changes of the station, by dotted key, such as ``servo.kp``.
        robot: name of the robot if it has legs. If it is None, the only robot of the station. It is not used for arms.
        legs: whether a robot with legs performs the program; otherwise the arms of a workcell do.
        code: whether the station names Python code, which it may run only if the script allows it.
        file: file of the script, with the path of its folder. The folder of the result is named after it.

    Returns:
        Text of the script. Nothing is written to the file.
    """
    is_in_folder = Path(station).parent == file.parent
    # Script and station can then be moved together.
    location = (
        f'Path(__file__).with_name("{Path(station).name}")' if is_in_folder else _value(station)
    )
    changes = f", {_value(dict(settings))}" if settings else ""
    permission = ", allow_code=True" if code else ""
    # The script loads the station itself: the program's key `station` would have no effect.
    content = program.model_dump(mode="json", exclude={"station"}, exclude_defaults=True)
    arguments = "".join(_argument(key, value) for key, value in content.items())
    title = _for_docstring(program.description) or "A recorded program"
    parts = [
        f'"""{title}; its signals are in {file.stem}-run/signals.csv."""',
        _imports(legs=legs, needs_path=is_in_folder),
        f"station = load_station({location}{changes}{permission})",
        f"program = Program(\n{arguments})",
        f'{_run_statements(legs, robot)}\nprint(result)\nresult.save("{file.stem}-run", force=True)\n',
    ]
    return "\n\n".join(parts)


def _for_docstring(text: str) -> str:
    """Escape a text so that it can be written between triple double quotes of Python."""
    # Backslashes first: those of the escaped quotes must stay single.
    return text.replace("\\", "\\\\").replace('"""', '\\"\\"\\"')


def _imports(*, legs: bool, needs_path: bool) -> str:
    """Write the imports of a script.

    Args:
        legs: whether the script needs a robot with legs; otherwise it needs a workcell.
        needs_path: whether the script finds its station by its own path.
    """
    names = sorted(["LeggedRobot" if legs else "Workcell", "Program", "load_station"])
    own_import = f"from simrob_drake import {', '.join(names)}"
    # A blank line between modules of Python and others, as formatters want it.
    return f"from pathlib import Path\n\n{own_import}" if needs_path else own_import


def _run_statements(legs: bool, robot: str | None) -> str:
    """Write the statements that run the program and assign its result.

    Args:
        legs: whether a robot with legs performs the program.
        robot: name of this robot. If it is None, the only robot of the station.
    """
    if not legs:
        return "result = Workcell(station).perform(program)"
    name = f", {_value(robot)}" if robot else ""
    # `run` returns the result of the last run only; `result` joins all of them.
    return f"robot = LeggedRobot(station{name})\nrobot.run(program)\nresult = robot.result()"


def _argument(key: str, value: Any) -> str:
    """Write a keyword argument of a call, on a line of its own; a list has one line for each of its entries."""
    is_list = isinstance(value, Sequence) and not isinstance(value, str)
    if not is_list:
        return f"    {key}={_value(value)},\n"
    # Further lines of a long entry begin with the spaces by which `pformat` aligns them: they are indented as well.
    lines = [f"{_NESTED}{_value(entry)},\n".replace("\n ", f"\n{_NESTED} ") for entry in value]
    return f"    {key}=[\n{''.join(lines)}    ],\n"


def _value(value: Any) -> str:
    """Write a value as Python code. Strings get double quotes unless the text of the value contains such a quote."""
    text = pformat(value, width=_WIDTH, sort_dicts=False, compact=True)
    return text if '"' in text else text.replace("'", '"')
