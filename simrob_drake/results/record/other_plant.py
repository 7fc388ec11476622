"""Positions of a run in another plant of the same station, such as the plant of a picture.

A station that shares a plant with others is recorded with the positions of the whole plant. Pictures and pickled
results have a plant of the station alone.
"""

from typing import Any

import numpy as np

from simrob_drake.base.frames import Vector
from simrob_drake.parts.station_plant import StationPlant
from simrob_drake.results.record.state import joints_of


def positions_in(station: StationPlant, run: Any, times: Vector) -> Vector:
    """Positions of another plant of a run's station, shape (k, nq) [rad or m, quaternions for free bodies].

    Args:
        station: the other plant, which contains the station alone.
        run: the `RecordedRun`.
        times: times within the run, shape (k,) [s].
    """
    recorded: Vector = run.positions_at(times)
    own: StationPlant = run.plant
    if not own.is_shared:
        return recorded
    places_in_own = {name: places for name, places, _ in joints_of(own.plant, own.scope)}
    context = station.plant.CreateDefaultContext()
    positions = np.tile(station.plant.GetPositions(context), (len(times), 1))
    for name, places, _ in joints_of(station.plant):
        positions[:, places] = recorded[:, places_in_own[name]]
    return positions
