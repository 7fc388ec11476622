"""Contact forces in a recording: an arrow where things touch, as long as the force is large."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from pydrake.common.value import Value
from pydrake.geometry import Meshcat
from pydrake.multibody.meshcat import ContactVisualizer, ContactVisualizerParams
from pydrake.multibody.plant import ContactResults

from simrob_drake.blocks.contacts import Contacts
from simrob_drake.frames import Vector
from simrob_drake.results.record.run import RecordedRun

_LENGTH = 0.12  # m, of the arrow of a typical large force
_LARGE = 95  # percentile of the forces that is drawn at that length: a blow may be longer
_SMALLEST = 0.01  # part of that force that is still drawn
_RADIUS = 0.003  # m


def draw_contact_forces(meshcat: Meshcat, result: RecordedRun, times: Vector, shown: Sequence[float]) -> None:
    """Draw the contact forces of a run into a Meshcat window that records.

    They are computed from the recorded states; nothing is drawn in a station without contact.

    Args:
        meshcat: where to.
        result: the run.
        times: of the run, shape (k,) [s].
        shown: when each appears in the recording [s].
    """
    if result.contacts_at is None:
        return
    forces = np.vstack([Contacts.of(results).forces for results in result.contacts_at(times)])
    sizes = np.linalg.norm(forces, axis=1)
    if not sizes.size:
        return
    large = max(float(np.percentile(sizes, _LARGE)), np.finfo(float).tiny)
    params = ContactVisualizerParams(
        prefix="contact_forces",
        force_threshold=_SMALLEST * large,
        newtons_per_meter=large / _LENGTH,
        radius=_RADIUS,
    )
    arrows = ContactVisualizer(meshcat, params)
    context = arrows.CreateDefaultContext()
    for time, results in zip(shown, result.contacts_at(times), strict=True):
        context.SetTime(time)
        arrows.contact_results_input_port().FixValue(context, Value[ContactResults](results))
        arrows.ForcedPublish(context)
