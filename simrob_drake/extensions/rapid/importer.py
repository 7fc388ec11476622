"""The importer of RAPID modules, the programs of ABB's controllers."""

from pathlib import Path
from typing import ClassVar

from simrob_drake.base.messages import message
from simrob_drake.programs.program_importer import (
    ImportedProgram,
    ProgramImporter,
    ProgramRemark,
    ProgramRequest,
)


class RapidImporter(ProgramImporter):
    """Reads the main procedure of a RAPID module, or of the modules that a `.pgf` lists."""

    title: ClassVar[str] = message("rapid.a_rapid_module", "a RAPID module")

    def read_program(self, file: Path, request: ProgramRequest) -> ImportedProgram:
        """Interpret the main procedure, without simulating the station, and collect its moves.

        Args:
            file: the module, or a list of modules (`.pgf`).
            request: request of the user.

        Raises:
            RapidError: a line cannot be understood or done; the message names the file and the line.
        """
        from simrob_drake.extensions.rapid.importing import import_rapid

        found = import_rapid(
            file,
            request.config,
            robot=request.robot,
            signals=request.signals,
            cycles=request.cycles,
            check=request.check,
        )
        remarks = tuple(
            ProgramRemark(text=str(remark), is_lost=remark.lost) for remark in found.remarks
        )
        return ImportedProgram(
            program=found.program, duration=found.time, remarks=remarks, lines=found.lines
        )
