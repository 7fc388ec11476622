"""Force limits by body region, from ``models/limits/iso_ts_15066.yaml``, which names its source."""

from __future__ import annotations

from functools import cache

from simrob_drake.errors import UnknownName
from simrob_drake.paths import models_root
from simrob_drake.quantities import Positive
from simrob_drake.yaml_files import Strict, read_yaml, validated


class _Table(Strict):
    source: str
    unit: str
    quasi_static_force: dict[str, Positive]


@cache
def quasi_static_limits() -> dict[str, float]:
    """Return the largest quasi-static forces [N] by body region."""
    file = models_root() / "limits" / "iso_ts_15066.yaml"
    return dict(validated(_Table, read_yaml(file), file).quasi_static_force)


def force_limit(limit: float | str) -> float:
    """Return a limit [N]: a number as it is, a body region's from the table.

    Raises:
        UnknownName: no such region.
    """
    if not isinstance(limit, str):
        return limit
    regions = quasi_static_limits()
    if limit not in regions:
        raise UnknownName("body region", limit, regions)
    return regions[limit]
