"""A script of a robot of one's own, with all that it reads, in one file to be taken elsewhere."""

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from zipfile import ZIP_DEFLATED, ZipFile

from simrob_drake.folders import writing
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.load import station_yaml
from simrob_drake.stations.located import carried


def pack(file: Path, config: StationConfig, script: Callable[[Path], str]) -> None:
    """Write a ZIP with a folder of its name: a script, the station that it runs, and copies of what that names.

    Args:
        file: to be written; one that is there is replaced.
        config: the station, with its settings.
        script: gives the text for the file of a station that lies beside the script.

    Raises:
        OutputError: the disk does not take it.
    """
    with writing(file), TemporaryDirectory(dir=file.parent) as place:
        folder = Path(place)
        station = folder / f"{file.stem}-station.yaml"
        station.write_text(station_yaml(carried(config, folder)), encoding="utf-8")
        (folder / f"{file.stem}.py").write_text(script(station), encoding="utf-8")
        whole = folder / file.name
        with ZipFile(whole, "w", ZIP_DEFLATED) as packed:
            for one in sorted(folder.rglob("*")):
                if one.is_file() and one != whole:
                    packed.write(one, Path(file.stem) / one.relative_to(folder))
        whole.replace(file)
