"""Importer of posture lists: text files with one posture on each line, which become a program of joint moves.

# arm.postures: a name, then the angle of each joint in degrees
left   30 0 0 0 60 0
right -30 0 0 0 60 0
pause  0.5
"""

from pathlib import Path
from typing import ClassVar

from simrob_drake.base.errors import InvalidConfig
from simrob_drake.base.files import text_of
from simrob_drake.programs.program_importer import (
    ImportedProgram,
    ProgramImporter,
    ProgramRemark,
    ProgramRequest,
)

_LARGEST_FILE = 1_000_000  # bytes
_MOVE_TIME = 1.5  # s, of the move to each posture


class PostureList(ProgramImporter):
    """Reads a list of postures."""

    title: ClassVar[str] = "a list of postures"

    def read_program(self, file: Path, request: ProgramRequest) -> ImportedProgram:
        """Make a move to each posture, and wait for each pause. Lines that are neither are reported as lost.

        Raises:
            InvalidConfig: a posture has the wrong number of angles; the message names the line.
        """
        from simrob_drake.programs.moves.kinds import check_move
        from simrob_drake.programs.program import Program
        from simrob_drake.stations.resolve import resolve

        robots = resolve(request.config).robots
        robot = robots[request.robot or next(iter(robots))]
        moves = []
        lines = dict[int, str]()
        remarks = []
        duration = 0.0
        for number, line in enumerate(text_of(file, _LARGEST_FILE).splitlines(), start=1):
            name, *words = line.partition("#")[0].split() or [""]
            if not name:
                continue
            values = _numbers(words)
            if values is None:
                remarks.append(
                    ProgramRemark(
                        f"{file.name}: line {number}: {line.strip()} is no posture", is_lost=True
                    )
                )
            elif name == "pause" and len(values) == 1:
                moves.append(check_move({"wait": values[0]}))
                duration += values[0]
            elif len(values) != len(robot.axes):
                problem = f"{name} has {len(values)} angles; {robot.model.name} has {len(robot.axes)} joints"
                raise InvalidConfig(file, f"line {number}", problem)
            else:
                # Messages about a run then name the line, not only the number of the move.
                lines[len(moves)] = f"{file.name}: line {number}"
                moves.append(
                    check_move({"move_abs_j": {"targets_deg": values, "duration": _MOVE_TIME}})
                )
                duration += _MOVE_TIME
        program = Program(
            description=f"Postures of {file.name}", robot=request.robot, moves=tuple(moves)
        )
        return ImportedProgram(
            program=program, duration=duration, remarks=tuple(remarks), lines=lines
        )


def _numbers(words: list[str]) -> list[float] | None:
    """Convert words to numbers. Returns None if one of them is no number."""
    try:
        return [float(word) for word in words]
    except ValueError:
        return None
