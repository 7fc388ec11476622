"""Positions of a run in another plant of the same station, such as the plant of a picture.

A station that shares a plant with others is recorded with the positions of the whole plant. Pictures and pickled
results have a plant of the station alone.
"""

from typing import Any, TypeAlias

import numpy as np

from simrob_drake.base.frames import Vector
from simrob_drake.parts.station_plant import StationPlant
from simrob_drake.results.record.state import joints_of

Run: TypeAlias = Any
"""A `RecordedRun`. Its module needs this one, so the class cannot be named here."""


def positions_in(station: StationPlant, run: Run, times: Vector) -> Vector:
    """Positions of another plant of a run's station, shape (k, nq) [rad or m, quaternions for free bodies].

    Args:
        station: the other plant, which contains the station alone.
        run: the run. If its plant is shared, it was recorded with the positions of the whole plant.
        times: times within the run, shape (k,) [s].
    """
    recorded: Vector = run.positions_at(times)
    own: StationPlant = run.plant  # the plant of the run itself
    if not own.is_shared:
        # Both plants contain the station alone, so their joints are the same, in the same order.
        return recorded
    # Joints have the same names in both plants, once the prefix of the station in the shared plant is removed.
    recorded_positions = {joint.name: joint.positions for joint in joints_of(own.plant, own.scope)}
    context = station.plant.CreateDefaultContext()
    # Every joint gets its recorded positions below; the defaults only give the array its shape.
    positions = np.tile(station.plant.GetPositions(context), (len(times), 1))
    for joint in joints_of(station.plant):
        positions[:, joint.positions] = recorded[:, recorded_positions[joint.name]]
    return positions
