"""The exporters of programs as RAPID modules and as URScript."""

from pathlib import Path
from typing import Any, ClassVar

from simrob_drake.programs.exporter import ExportedTexts, ProgramExporter
from simrob_drake.programs.program import Program
from simrob_drake.stations.config import StationConfig


class RapidExporter(ProgramExporter):
    """Writes a program as a RAPID module, with a table of its signals next to it."""

    help: ClassVar[str] = "The RAPID module of a program to write, FILE.mod."

    def program_texts(
        self, program: Program, config: StationConfig, file: Path, options: Any, *, source: str
    ) -> ExportedTexts:
        """Translate a program into RAPID.

        Raises:
            SimrobError: the program cannot be done, or RAPID cannot express it; the message names the move.
        """
        from simrob_drake.extensions.rapid.exporting import ExportedProgram, rapid_text
        from simrob_drake.programs.arm import Workcell

        steps = ExportedProgram.of(program, Workcell(config), source)
        module, signals = rapid_text(steps, file.stem)
        texts = {file: module}
        if signals:
            texts[file.with_name(f"{file.stem}_io.yaml")] = signals
        return ExportedTexts(texts, tuple(steps.remarks))


class UrscriptExporter(ProgramExporter):
    """Writes a program as URScript, the language of Universal Robots' controllers."""

    help: ClassVar[str] = "The URScript of a program to write, FILE.script."

    def program_texts(
        self, program: Program, config: StationConfig, file: Path, options: Any, *, source: str
    ) -> ExportedTexts:
        """Translate a program into URScript.

        Raises:
            SimrobError: the program cannot be done, or URScript cannot express it; the message names the move.
        """
        from simrob_drake.extensions.rapid.exporting import ExportedProgram, urscript_text
        from simrob_drake.programs.arm import Workcell

        steps = ExportedProgram.of(program, Workcell(config), source)
        return ExportedTexts({file: urscript_text(steps, file.stem)}, tuple(steps.remarks))
