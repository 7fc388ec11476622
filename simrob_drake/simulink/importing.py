"""Import a Simulink model: from `.slx` to a folder with robots, pieces and a station that runs."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from simrob_drake.arguments import as_path
from simrob_drake.folders import filled_at_once
from simrob_drake.importer.options import ImportReport
from simrob_drake.simulink.coverage import BlockOutcome, fidelity, outcomes
from simrob_drake.simulink.simulink_model import SimulinkModel, read_simulink, undefined_variables
from simrob_drake.simulink.writing.station import StationWriter
from simrob_drake.simulink.writing.touching import StationFiles
from simrob_drake.simulink.writing.urdf import plain

REPORT_FILE = "report.json"


@dataclass(frozen=True)
class ImportedModel:
    """What an import made.

    Attributes:
        model: what was read.
        files: what was written.
        station: the station's file; None where nothing moves.
        outcomes: what became of every block.
    """

    model: SimulinkModel
    files: StationFiles
    station: Path | None
    outcomes: list[BlockOutcome]

    @property
    def fidelity(self) -> str:
        """How faithful the station is, in one line."""
        return fidelity(self.outcomes, len(self.files.content.get("prescribed", ())))

    @property
    def report(self) -> ImportReport:
        """What became of the blocks."""
        return self.model.report


def import_simulink(path: Path | str, folder: Path | str, *, force: bool = False, **options: Any) -> ImportedModel:
    """Write the robots, pieces and station of a model into a folder, with a report.

    Args:
        path: `.slx` or `.mdl`, or the `.xml` of a CAD assembly.
        folder: where to; it appears at once, when everything is in it.
        force: replace an import that is there.
        options: of :func:`~simrob_drake.simulink.simulink_model.read_simulink`.

    Raises:
        InvalidModel: the model cannot be read, uses variables that are not known, or holds what no station can be.
        OutputError: the folder cannot be written, or exists.
    """
    path, folder = as_path(path, "path"), as_path(folder, "folder")
    model = read_simulink(path, **options)
    check_importable(model)
    with filled_at_once(folder, marker=REPORT_FILE, force=force) as work:
        files = StationWriter(model, work).write()
        found = outcomes(model)
        report = {
            "fidelity": fidelity(found, len(files.content.get("prescribed", ()))),
            **model.report.as_json(),
            "blocks": [asdict(outcome) for outcome in found],
        }
        text = json.dumps(report, indent=2, ensure_ascii=False)
        (work / REPORT_FILE).write_text(text + "\n", encoding="utf-8")
    return ImportedModel(model, files, folder / f"{plain(path.stem)}.yaml" if files.content else None, found)


def check_importable(model: SimulinkModel) -> None:
    """Check that a station can be made of a model.

    Raises:
        InvalidModel: variables that are not known, or what was refused.
    """
    missing = undefined_variables(model)
    if missing is not None and not model.findings.assume:
        raise missing
    refused = model.report.of("refused")
    if refused:
        more = f" (and {len(refused) - 1} more: simrob check {model.path.name})" if len(refused) > 1 else ""
        raise model.report.refusal(refused[0].element, refused[0].text + more)
    weighs = any(body.solids for body in model.bodies.bodies)
    if not weighs and not model.bodies.links:
        raise model.report.refusal("", "holds no Simscape Multibody bodies: there is nothing to simulate")
