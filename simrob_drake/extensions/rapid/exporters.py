"""The exporters of programs as RAPID modules and as URScript."""

from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from simrob_drake.base.messages import message
from simrob_drake.programs.exporter import ExportedTexts, ProgramExporter
from simrob_drake.programs.program import Program
from simrob_drake.stations.config import StationConfig

if TYPE_CHECKING:
    from simrob_drake.extensions.rapid.exporting import ExportedProgram


class RapidExporter(ProgramExporter):
    """Writes a program as a RAPID module, with a table of its signals next to it."""

    help: ClassVar[str] = message(
        "rapid.help_rapid_file", "The RAPID module of a program to write, FILE.mod."
    )

    def program_texts(
        self, program: Program, config: StationConfig, file: Path, options: Any, *, source: str
    ) -> ExportedTexts:
        """Translate a program into RAPID.

        Args:
            program: the program.
            config: the station on which it is done.
            file: the file that will be written; its stem is the name of the module.
            options: not used.
            source: path of the program's own file, for messages.

        Returns:
            the text of the module and, if the program uses signals, of the table ``<stem>_io.yaml`` next to it.

        Raises:
            SimrobError: the program cannot be done, or RAPID cannot express it; the message names the move.
        """
        # not at the top: see _steps_of()
        from simrob_drake.extensions.rapid.exporting import (
            rapid_text,
        )

        exported = _steps_of(program, config, source)
        module, signals = rapid_text(exported, file.stem)
        texts = {file: module}
        if signals:
            texts[file.with_name(f"{file.stem}_io.yaml")] = signals
        return ExportedTexts(texts, tuple(exported.remarks))


class UrscriptExporter(ProgramExporter):
    """Writes a program as URScript, the language of Universal Robots' controllers."""

    help: ClassVar[str] = message(
        "rapid.help_urscript_file", "The URScript of a program to write, FILE.script."
    )

    def program_texts(
        self, program: Program, config: StationConfig, file: Path, options: Any, *, source: str
    ) -> ExportedTexts:
        """Translate a program into URScript.

        Args:
            program: the program.
            config: the station on which it is done.
            file: the file that will be written; its stem is the name of the script's function.
            options: not used.
            source: path of the program's own file, for messages.

        Returns:
            the text of the script.

        Raises:
            SimrobError: the program cannot be done, or URScript cannot express it; the message names the move.
        """
        # not at the top: see _steps_of()
        from simrob_drake.extensions.rapid.exporting import (
            urscript_text,
        )

        exported = _steps_of(program, config, source)
        return ExportedTexts({file: urscript_text(exported, file.stem)}, tuple(exported.remarks))


def _steps_of(program: Program, config: StationConfig, source: str) -> "ExportedProgram":
    """Do a program on its station, without a run, and note its steps. Arguments and errors are as for `program_texts`.

    The imports load scipy and Drake's plant. The help of the command lists the exporters and does not need these.
    """
    from simrob_drake.extensions.rapid.exporting import ExportedProgram
    from simrob_drake.programs.arm import Workcell

    return ExportedProgram.of(program, Workcell(config), source)
