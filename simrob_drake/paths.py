"""Where the robots, pieces and stations that come with the package lie."""

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent


def data_root() -> Path:
    """Return the folder that holds ``models`` and ``diagrams``: inside the wheel, or the top of a checkout."""
    installed = _PACKAGE / "data"
    return installed if installed.is_dir() else _PACKAGE.parent


def models_root() -> Path:
    """Return the folder with one folder a robot, and ``pieces``."""
    return data_root() / "models"


def diagrams_root() -> Path:
    """Return the folder with one YAML file a station."""
    return data_root() / "diagrams"
