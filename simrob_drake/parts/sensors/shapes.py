"""What collision shapes feel: how near another thing is, and the force with which it presses."""

from collections.abc import Collection, Sequence
from typing import ClassVar, Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field, model_validator
from pydrake.geometry import GeometryId
from pydrake.multibody.tree import Frame
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import Demultiplexer

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.base.sections import Integer, NotNegative
from simrob_drake.base.signals import Recorded, Signal, sensor_panel
from simrob_drake.blocks.block import add_and_connect
from simrob_drake.blocks.command_bus import round_to_resolution
from simrob_drake.blocks.contacts import ContactReader, Contacts, DistanceSensor, ForceSensor
from simrob_drake.blocks.sampled import Changes, Named, SampledBlock
from simrob_drake.parts.resolved import Surroundings
from simrob_drake.parts.sensors.sensor import ShapeSensor, axis_names, check_contact, normal, sampled, sensor_label
from simrob_drake.parts.site import Site
from simrob_drake.parts.targets import check_body, check_frame, frame_of, shapes_of


class Distance(ShapeSensor):
    """Signed distance between two things [m]; negative: how deep they are in each other."""

    measures_shapes: ClassVar[bool] = True

    kind: Literal["distance"]
    other: str = "floor"
    """A robot, a link, a piece, a shape of a piece, or `floor`."""

    def check(self, key: str, station: Surroundings) -> None:
        """Check that both things exist, and that the plant has shapes."""
        check_body(station, f"{key}.body", self.body)
        check_body(station, f"{key}.other", self.other)
        if station.engine.moves_by_forces:
            check_contact(key, message("parts.a_distance_sensor", "a distance sensor"), station)

    def wire(self, builder: DiagramBuilder, site: Site, name: str) -> None:
        """Add ``distance.<sensor>`` (1) [m]."""
        body, other = (shapes_of(site.plant, site.station, target) for target in (self.body, self.other))
        scene_graph = site.plant.scene_graph
        block = DistanceSensor(body=body, other=other, inspector=scene_graph.model_inspector())
        distance = add_and_connect(builder, f"sensor.{name}", block, scene_graph.get_query_output_port())
        site.picture.draw(
            f"sensor.{name}",
            "sensor",
            sensor_label(message("parts.block_distance_sensor", "Distance sensor"), name, self.rate),
        )
        port, output = sampled(builder, f"sensor.{name}.hold", distance, self.rate), f"distance.{name}"
        panel = sensor_panel(message("parts.distance_of", "distance '{name}'", name=name), "distance", [output])
        site.outputs.add(output, port, Signal((output,), ("m",), "distance", output, part=name, panel=panel))


_CONTACTS = "contacts"

Tangential = Literal["contact", "momentum balance", "left out"]
"""Where a force along the surfaces comes from. The scheme ``cenic`` gives it wrongly: there it is found after the run
from the momentum of the model that the sensor sits on, if that stands free; of an arm, whose base holds it, and in a
loop it cannot be told."""


class Force(ShapeSensor):
    """Contact force [N] and moment [N·m] on a body."""

    kind: Literal["force"]
    other: str | None = None
    """What presses on the body: a robot, a link, a piece, a shape of a piece, or `floor`; everything unless given."""
    frame: str = "world"
    """In whose axes force and moment are given, and about whose origin the moment: `world`, a tool, link or piece."""
    resolution: NotNegative = 0.0
    """Step from one force that it tells to the next [N]; 0 for none."""
    moment_resolution: NotNegative = 0.0
    """Likewise [N·m]."""
    noise: NotNegative = 0.0
    """Standard deviation of a sample of each axis of the force [N]."""
    moment_noise: NotNegative = 0.0
    """Likewise [N·m]."""
    delay: NotNegative = 0.0
    """How late it tells them [s], to the nearest sample."""
    seed: Integer = Field(default=0, ge=0)
    """Of the noise: the same seed, the same figures."""

    @property
    def _errs(self) -> bool:
        errors = self.resolution, self.moment_resolution, self.noise, self.moment_noise, self.delay
        return any(errors)

    @model_validator(mode="after")
    def _samples_to_err(self) -> "Force":
        if self._errs and self.rate is None:
            raise ValueError(
                message(
                    "parts.force_sensor_needs_rate",
                    "a force sensor with noise, a resolution or a delay samples: it needs a rate",
                )
            )
        return self

    def check(self, key: str, station: Surroundings) -> None:
        """Check that its bodies and its frame exist, and that the station computes contacts."""
        check_body(station, f"{key}.body", self.body)
        if self.other is not None:
            check_body(station, f"{key}.other", self.other)
        if not station.engine.moves_by_forces:
            expected = message(
                "parts.contacts_in_dynamic_station",
                "in a dynamic station: a kinematic one computes no contacts (a distance sensor works there)",
            )
            raise InvalidParameter(
                key,
                message("parts.force_sensor_in_kinematic_station", "a force sensor in a kinematic station"),
                expected,
            )
        check_frame(station, f"{key}.frame", self.frame)
        check_contact(key, message("parts.a_force_sensor", "a force sensor"), station)

    def wire(self, builder: DiagramBuilder, site: Site, name: str) -> None:
        """Add ``force.<sensor>`` (3) [N] and ``moment.<sensor>`` (3) [N·m]."""
        plant, frame = site.plant.plant, frame_of(site.plant, self.frame)
        body = shapes_of(site.plant, site.station, self.body)
        other = None if self.other is None else shapes_of(site.plant, site.station, self.other)
        normal_only = not site.station.engine.reports_friction_of_contacts
        block = ForceSensor(plant=plant, body=body, other=other, frame=frame, normal_only=normal_only)
        poses = site.plant.stepped.get_body_poses_output_port()
        wrench = add_and_connect(builder, f"sensor.{name}", block, _contacts(builder, site), poses)
        site.picture.draw(
            f"sensor.{name}",
            "sensor",
            sensor_label(message("parts.block_force_sensor", "Force sensor"), name, self.rate),
        )
        split = Demultiplexer([3, 3])
        add_and_connect(builder, f"sensor.{name}.split", split, self._reported(builder, f"sensor.{name}.hold", wrench))
        tangential = self._tangential(site, body[0])
        balance = MomentumBalance(site, frame, body, other) if tangential == "momentum balance" else None
        site.outputs.notes[name]["tangential"] = tangential
        title = message("parts.contact_force_of", "contact force '{name}'", name=name)
        if tangential != "contact":
            title += message("parts.along_the_surface", " (along the surface: {source})", source=tangential)
        names, moments = axis_names("force", name), axis_names("moment", name)
        felt = Signal(
            names,
            ("N",) * 3,
            "force",
            f"force.{name}",
            part=name,
            panel=sensor_panel(title, "force", names),
            adjust=None if balance is None else balance.with_friction,
        )
        site.outputs.add(f"force.{name}", split.get_output_port(0), felt)
        moment = Signal(moments, ("N·m",) * 3, "moment", f"moment.{name}", part=name)
        site.outputs.add(f"moment.{name}", split.get_output_port(1), moment)

    def _reported(self, builder: DiagramBuilder, name: str, wrench: OutputPort) -> OutputPort:
        if self.rate is None or not self._errs:
            return sampled(builder, name, wrench, self.rate)
        return add_and_connect(builder, name, MeasuredWrench(self, self.rate), wrench)

    def _tangential(self, site: Site, shape: GeometryId) -> Tangential:
        if site.station.engine.reports_friction_of_contacts:
            return "contact"
        plant, inspector = site.plant.plant, site.plant.scene_graph.model_inspector()
        instance = plant.GetBodyFromFrameId(inspector.GetFrameId(shape)).model_instance()
        free = any(plant.get_body(index).is_floating_base_body() for index in plant.GetBodyIndices(instance))
        return "momentum balance" if free and self.rate is None else "left out"


class MeasuredWrench(SampledBlock):
    r"""Sample a force and a moment as a sensor tells them: rounded, noisy, and as many samples late as it says.

    .. math:: \hat f_k = \mathrm{round}(f_k + n_k)

    Ports:
        in  ``wrench`` (6): force [N], then moment [N·m].
        out ``wrench`` (6), likewise.
    """

    def __init__(self, section: Force, rate: float) -> None:
        """Make the block of a section that takes so many samples a second [Hz]."""
        memory = {"wrench": np.zeros(6), "count": np.zeros(1)}
        delay = round(section.delay * rate)
        super().__init__(
            period=1 / rate, reads={"wrench": 6}, memory=memory, gives=("wrench",), delay=delay, at_once=True
        )
        self._resolution = np.repeat([section.resolution, section.moment_resolution], 3)
        self._noise, self.seed = np.repeat([section.noise, section.moment_noise], 3), section.seed

    def sample(self, memory: Named, read: Named) -> Changes:
        """Return what the sensor tells now."""
        count = int(memory["count"].item())
        measured = round_to_resolution(read["wrench"] + self._noise * normal(self.seed, count, 6), self._resolution)
        return {"wrench": measured, "count": count + 1}


def _contacts(builder: DiagramBuilder, site: Site) -> OutputPort:
    """Return the port of the block that reads the plant's contacts for all sensors; the first one adds it."""
    if site.plant.stand_in is not None:
        return site.plant.stand_in.get_contact_results_output_port()
    if not builder.HasSubsystemNamed(_CONTACTS):
        add_and_connect(builder, _CONTACTS, ContactReader(), site.plant.stepped.get_contact_results_output_port())
        site.picture.draw_nothing(_CONTACTS)
    return builder.GetSubsystemByName(_CONTACTS).get_output_port()


_NO_LOAD = 1e-9  # N


class MomentumBalance:
    r"""What one sensor has of the friction on its model under the scheme ``cenic``, from its balance of momentum.

    The mean force of all contacts on a model over a step is :math:`\bar f = (P_1 - P_0)/h - m g` with its momentum P at
    the ends of the step. Drake's contact results give the parts along the normals; what is left across them goes to a
    sensor in proportion to its share of all that is pressed on the model: one foot of two cannot be told otherwise.
    What sensors have in common, contacts and momenta, is worked out once a run: it lies in the run's memo.
    """

    def __init__(
        self, site: Site, frame: Frame, body: Collection[GeometryId], other: Collection[GeometryId] | None
    ) -> None:
        """Look at the forces of ``other`` shapes, all unless given, on those of ``body``, in the axes of a frame."""
        self._plant, self._state = site.plant.plant, site.state
        self._contacts = site.plant.plant.get_contact_results_output_port()
        self._frame, self._body, self._other = frame, set(body), None if other is None else set(other)
        plant, inspector = self._plant, site.plant.scene_graph.model_inspector()
        self._instance = plant.GetBodyFromFrameId(inspector.GetFrameId(next(iter(self._body)))).model_instance()
        bodies = [plant.get_body(index) for index in plant.GetBodyIndices(self._instance)]
        self._shapes = {shape for part in bodies for shape in plant.GetCollisionGeometriesForBody(part)}

    def with_friction(self, recorded: Recorded, times: Vector, forces: Vector) -> Vector:
        """Return forces along the normals at times (m,) [s] with the sensor's share of those across, (m, 3) [N]."""
        if len(recorded.step_times) < 2:
            return forces
        contacts, rows = self._all_contacts(recorded, times)
        key = ("contact force", int(self._instance), times.tobytes())
        if key not in recorded.memo:
            recorded.memo[key] = self._mean_contact_forces(recorded, times)
        totals: Vector = recorded.memo[key]
        across = self._across(totals, contacts, rows)
        turns = np.empty((len(times), 3, 3))
        context = self._plant.CreateDefaultContext()
        for row, state in enumerate(recorded.sample([self._state], times)[0]):
            self._plant.SetPositionsAndVelocities(context, state)
            turns[row] = self._frame.CalcPoseInWorld(context).rotation().matrix()
        return np.asarray(forces + np.einsum("mji,mj->mi", turns, across))

    def _all_contacts(self, recorded: Recorded, times: Vector) -> tuple[Contacts, npt.NDArray[np.intp]]:
        """Return the contacts of all times, and to which time each of them belongs, shape (k,)."""
        key = ("contacts", times.tobytes())
        if key not in recorded.memo:
            moments: Sequence[Contacts] = [Contacts.of(found) for found in recorded.sample([self._contacts], times)[0]]
            rows = np.repeat(range(len(times)), [len(each.pairs) for each in moments])
            recorded.memo[key] = Contacts.concatenate(moments), rows
        contacts: tuple[Contacts, npt.NDArray[np.intp]] = recorded.memo[key]
        return contacts

    def _across(self, totals: Vector, contacts: Contacts, rows: npt.NDArray[np.intp]) -> Vector:
        """Return the sensor's share of what is across the normals, shape (m, 3) [N], in the world's axes.

        ``totals`` are of all forces on the sensor's model, shape (m, 3) [N]; ``rows`` (k,) tells to which time each
        contact belongs.
        """

        def summed(values: Vector) -> Vector:
            return np.asarray(np.bincount(rows, values, len(totals)), dtype=float)

        senses = contacts.force_signs(self._shapes)
        normals = senses[:, np.newaxis] * contacts.normal_forces
        sizes = np.linalg.norm(normals, axis=1)
        pressed, here = summed(sizes), summed(sizes * np.abs(contacts.force_signs(self._body, self._other)))
        normal = np.column_stack([summed(column) for column in normals.T])
        loaded = (pressed > _NO_LOAD)[:, np.newaxis]
        along = np.divide(
            normal, np.linalg.norm(normal, axis=1, keepdims=True), out=np.zeros_like(normal), where=loaded
        )
        across = totals - (totals * along).sum(axis=1, keepdims=True) * along
        share = np.divide(here, pressed, out=np.zeros_like(here), where=loaded[:, 0])
        return np.asarray(share[:, np.newaxis] * across)

    def _mean_contact_forces(self, recorded: Recorded, times: Vector) -> Vector:
        plant, knots = self._plant, recorded.step_times
        context = plant.CreateDefaultContext()
        ends = np.clip(np.searchsorted(knots, times, side="left"), 1, len(knots) - 1)
        steps = np.unique(np.append(ends, ends - 1))
        (states,) = recorded.sample([self._state], knots[steps])
        momenta = np.empty((len(knots), 3))
        for step, state in zip(steps, states, strict=True):
            plant.SetPositionsAndVelocities(context, state)
            momentum = plant.CalcSpatialMomentumInWorldAboutPoint(context, [self._instance], np.zeros(3))
            momenta[step] = momentum.translational()
        rates = (momenta[ends] - momenta[ends - 1]) / (knots[ends] - knots[ends - 1])[:, np.newaxis]
        weight = plant.CalcTotalMass(context, [self._instance]) * plant.gravity_field().gravity_vector()
        return np.asarray(rates - weight)
