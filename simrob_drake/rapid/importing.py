"""A RAPID program as a program of this package: what its main procedure does, move by move."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from simrob_drake.arguments import as_path
from simrob_drake.programs.arm import Workcell
from simrob_drake.programs.plan import CHECKED, Check
from simrob_drake.programs.program import Program
from simrob_drake.rapid.controller import Controller
from simrob_drake.rapid.instructions import FUNCTIONS_OF_CONTROLLER, INSTRUCTIONS
from simrob_drake.rapid.interpreter import Interpreter
from simrob_drake.rapid.signals import Signals
from simrob_drake.rapid.syntax import RapidError, Remark, read_modules
from simrob_drake.stations.station import StationLike


@dataclass(frozen=True)
class Imported:
    """A program, and what its user should know of it."""

    program: Program  # the moves
    remarks: tuple[Remark, ...]  # about lines of the modules, in their order
    time: float  # that the program takes [s]
    lines: Mapping[int, str]  # the file and line of the last target of moves, by their number

    @property
    def lost(self) -> list[Remark]:
        """What was not understood, and so is not done."""
        return [remark for remark in self.remarks if remark.lost]


def import_rapid(
    files: Path | str | Sequence[Path | str],
    station: StationLike,
    *,
    robot: str | None = None,
    signals: Signals | Path | str | None = None,
    cycles: int = 1,
    check: Check = CHECKED,
) -> Imported:
    """Do a RAPID program's main procedure without a run, and return the moves that it makes on a station.

    ``files`` are of its modules, or a `.pgf`; the only robot need not be named; ``signals`` are what inputs and outputs
    mean, or a table's file; a loop WHILE TRUE is done ``cycles`` times; ``check`` is looked at before each move beside
    its reach. Raises RapidError: what cannot be understood or done; names the file and the line.
    """
    sources = [files] if isinstance(files, (Path, str)) else files
    modules = [module for file in sources for module in read_modules(as_path(file, "file"))]
    table = signals if isinstance(signals, Signals) else Signals() if signals is None else Signals.load(signals)
    cell = Workcell(station)
    controller = Controller(cell, robot, table, cell.run_plans if table.sensors else cell.stand, check)
    interpreter = Interpreter(
        modules,
        {name: partial(instruction, controller) for name, instruction in INSTRUCTIONS.items()},
        {name: partial(function, controller) for name, function in FUNCTIONS_OF_CONTROLLER.items()},
        lambda name: table.value(name, controller.time, controller.seen),
        cycles,
    )
    interpreter.run()
    controller.finish()
    if not any(move.takes_time for move in controller.moves):
        raise RapidError(f"{modules[0].file}: line 1", "its main makes no move")
    name = None if cell.config.only_robot else controller.robot
    program = Program(description=f"Of the RAPID module {modules[0].name}", robot=name, moves=tuple(controller.moves))
    remarks = sorted(interpreter.remarks, key=lambda remark: (remark.file, remark.line))
    return Imported(program, tuple(remarks), controller.time, controller.lines)
