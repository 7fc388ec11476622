"""Where the robots, pieces and stations that come with the package lie."""

from pathlib import Path

ROBOT_FILE, PIECE_FILE, EXERCISE_FILE = "robot.yaml", "piece.yaml", "exercise.yaml"
"""What the files are called that describe a robot, a piece and an exercise of the course."""
_PACKAGE = Path(__file__).resolve().parent


def data_root() -> Path:
    """Return the folder with ``models``, ``diagrams`` and ``course``: inside the wheel, or the top of a checkout."""
    installed = _PACKAGE / "data"
    return installed if installed.is_dir() else _PACKAGE.parent


def models_root() -> Path:
    """Return the folder with one folder a robot, and ``pieces``."""
    return data_root() / "models"


def diagrams_root() -> Path:
    """Return the folder with one YAML file a station."""
    return data_root() / "diagrams"


def station_files() -> dict[str, Path]:
    """Return the files of the stations that come with the package, by name."""
    return {file.stem: file for file in sorted(diagrams_root().glob("*.yaml"))}


def robot_files() -> dict[str, Path]:
    """Return the files of the robots that come with the package, by name."""
    return {file.parent.name: file for file in sorted(models_root().glob(f"*/{ROBOT_FILE}"))}


def piece_files() -> dict[str, Path]:
    """Return the files of the pieces that come with the package, by name."""
    return {file.parent.name: file for file in sorted(models_root().glob(f"pieces/*/{PIECE_FILE}"))}


def exercise_files() -> list[Path]:
    """Return the files of the exercises of the course that come with the package."""
    return sorted(data_root().glob(f"course/*/{EXERCISE_FILE}"))
