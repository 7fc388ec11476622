"""Sensors at collision shapes: the distance to another thing, and the contact force.

A class with the key ``kind`` is a section of ``sensors`` in a station file. The blocks are in
:mod:`simrob_drake.blocks.contacts`. A *model* is a model instance of Drake's plant: a robot with the pieces that it
carries, or a piece.
"""

from collections.abc import Collection, Sequence
from typing import ClassVar, Literal, NamedTuple

import numpy as np
import numpy.typing as npt
from pydantic import Field, model_validator
from pydrake.geometry import GeometryId
from pydrake.multibody.tree import Frame
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import Demultiplexer

from simrob_drake.base.errors import Unsuitable
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.base.sections import Integer, NotNegative
from simrob_drake.base.signals import Recorded, Signal, sensor_panel
from simrob_drake.blocks.block import add_and_connect
from simrob_drake.blocks.command_bus import round_to_resolution
from simrob_drake.blocks.contacts import ContactReader, Contacts, DistanceSensor, ForceSensor
from simrob_drake.blocks.sampled import Changes, Named, SampledBlock
from simrob_drake.parts.resolved import StationContents
from simrob_drake.parts.sensors.sensor import (
    ShapeSensor,
    add_sample_and_hold,
    axis_names,
    check_contact,
    normal_noise,
    sensor_label,
)
from simrob_drake.parts.site import Site
from simrob_drake.parts.targets import check_body, check_frame, frame_of, shapes_of


class Distance(ShapeSensor):
    """Signed distance between two things [m]; negative if they overlap."""

    measures_shapes: ClassVar[bool] = True

    kind: Literal["distance"]
    other: str = "floor"
    """A robot, a link, a piece, a shape of a piece, or `floor`."""

    def check(self, key: str, station: StationContents) -> None:
        """Check that both things exist, and that the plant has collision shapes.

        A dynamic station has shapes only with the section ``contact``. A kinematic station has them as soon as a sensor
        measures shapes, so it needs no check.

        Args:
            key: key of the sensor in the station, such as ``sensors.foot``, for errors.
            station: contents of the station.

        Raises:
            SimrobError: one of the two does not exist, or a dynamic station has no section ``contact``.
        """
        check_body(station, f"{key}.body", self.body)
        check_body(station, f"{key}.other", self.other)
        if station.engine.moves_by_forces:
            check_contact(key, message("parts.a_distance_sensor", "a distance sensor"), station)

    def wire(self, builder: DiagramBuilder, site: Site, name: str) -> None:
        """Add ``distance.<sensor>`` (1) [m].

        Args:
            builder: builder of the diagram.
            site: the station under construction.
            name: name of the sensor.

        Raises:
            InvalidParameter: one of the two has no collision shapes, or the collisions of all their shapes are filtered
                out, for example since both are parts of one robot.
        """
        body = shapes_of(site.plant, site.station, self.body)
        other = shapes_of(site.plant, site.station, self.other)
        scene_graph = site.plant.scene_graph
        block = DistanceSensor(body=body, other=other, inspector=scene_graph.model_inspector())
        system_name = f"sensor.{name}"
        distance = add_and_connect(builder, system_name, block, scene_graph.get_query_output_port())
        label = sensor_label(
            message("parts.block_distance_sensor", "Distance sensor"), name, self.rate
        )
        site.picture.draw(system_name, "sensor", label)
        port = add_sample_and_hold(builder, f"{system_name}.hold", distance, self.rate)

        output = f"distance.{name}"
        title = message("parts.distance_of", "distance '{name}'", name=name)
        panel = sensor_panel(title, "distance", [output])
        signal = Signal((output,), ("m",), "distance", output, part=name, panel=panel)
        site.outputs.add(output, port, signal)


# Name of the block that reads the plant's contacts for all sensors.
_CONTACTS = "contacts"

Tangential = Literal["contact", "momentum balance", "left out"]
"""Source of the part of a contact force along the surfaces.

It is the contact results, except with the scheme ``cenic``, which computes this part wrongly. There, it is computed
after the run from the momentum of the model that the sensor is at, if the model is free. It is left out for an arm,
whose base is held by an unknown force, and for a sensor with a ``rate``, whose samples are taken during the run.
"""


_FRICTION_REMARKS = {
    "momentum balance": message(
        "parts.friction_of_momentum", " (friction from the momentum balance)"
    ),
    "left out": message("parts.friction_left_out", " (without friction)"),
}
"""Remarks in the title of a plot, by the source of the force along the surfaces."""


class Force(ShapeSensor):
    """Contact force [N] and moment [N·m] on a body."""

    kind: Literal["force"]
    other: str | None = None
    """Body that presses: a robot, a link, a piece, a shape of a piece, or `floor`; if left out, everything counts."""
    frame: str = "world"
    """Frame of the force and the moment, and of the point for the moment: `world`, a tool, a link or a piece."""
    resolution: NotNegative = 0.0
    """Step between two forces that can be measured [N]; 0 rounds nothing."""
    moment_resolution: NotNegative = 0.0
    """Step between two moments that can be measured [N·m]; 0 rounds nothing."""
    noise: NotNegative = 0.0
    """Standard deviation of a sample of each axis of the force [N]."""
    moment_noise: NotNegative = 0.0
    """Standard deviation of a sample of each axis of the moment [N·m]."""
    delay: NotNegative = 0.0
    """Delay of its values [s], rounded to whole samples."""
    seed: Integer = Field(default=0, ge=0)
    """Seed of the noise: the same seed gives the same values."""

    @property
    def _has_errors(self) -> bool:
        """Whether the sensor rounds, adds noise or delays."""
        errors = (
            self.resolution,
            self.moment_resolution,
            self.noise,
            self.moment_noise,
            self.delay,
        )
        return any(errors)

    @model_validator(mode="after")
    def _check_rate(self) -> "Force":
        """Check that a sensor with errors has a rate: its errors are those of samples.

        Raises:
            ValueError: the sensor has errors (noise, a resolution or a delay) and no rate.
        """
        if self._has_errors and self.rate is None:
            raise ValueError(
                message(
                    "parts.force_sensor_needs_rate",
                    "a force sensor with noise, a resolution or a delay needs a rate",
                )
            )
        return self

    def check(self, key: str, station: StationContents) -> None:
        """Check that its bodies and its frame exist, and that the station computes contacts.

        Args:
            key: key of the sensor in the station, such as ``sensors.foot``, for errors.
            station: contents of the station.

        Raises:
            SimrobError: a body or the frame does not exist, the station is kinematic, or it has no section ``contact``.
        """
        check_body(station, f"{key}.body", self.body)
        if self.other is not None:
            check_body(station, f"{key}.other", self.other)
        if not station.engine.moves_by_forces:
            raise Unsuitable(
                key,
                message(
                    "parts.no_contact_forces", "a kinematic station computes no contact forces"
                ),
                message(
                    "parts.contacts_in_dynamic_station",
                    "set mode: dynamic, or use a distance sensor",
                ),
            )
        check_frame(station, f"{key}.frame", self.frame)
        check_contact(key, message("parts.a_force_sensor", "a force sensor"), station)

    def wire(self, builder: DiagramBuilder, site: Site, name: str) -> None:
        """Add ``force.<sensor>`` (3) [N] and ``moment.<sensor>`` (3) [N·m], in the axes of the sensor's frame.

        Args:
            builder: builder of the diagram.
            site: the station under construction.
            name: name of the sensor.

        Raises:
            InvalidParameter: a body has no collision shapes.
        """
        frame = frame_of(site.plant, self.frame)
        body = shapes_of(site.plant, site.station, self.body)
        other = None if self.other is None else shapes_of(site.plant, site.station, self.other)
        block = ForceSensor(
            plant=site.plant.plant,
            body=body,
            other=other,
            frame=frame,
            # Wrong friction forces would be worse than none.
            normal_only=not site.station.engine.reports_friction_of_contacts,
        )
        # The wrench (6): force [N], then moment [N·m].
        contacts = _contacts_port(builder, site)
        poses = site.plant.plant_block.get_body_poses_output_port()
        wrench = add_and_connect(builder, f"sensor.{name}", block, contacts, poses)
        label = sensor_label(message("parts.block_force_sensor", "Force sensor"), name, self.rate)
        site.picture.draw(f"sensor.{name}", "sensor", label)
        reported = self._add_samples(builder, f"sensor.{name}.hold", wrench)
        split = Demultiplexer([3, 3])
        add_and_connect(builder, f"sensor.{name}.split", split, reported)

        # If the contact results lack friction, it is added after the run, or the result says that it is missing.
        # All shapes of the sensor's body belong to one model, so the model of one is that of all.
        tangential = self._tangential_source(site, body[0])
        # The station has made the note of each sensor before it wires the sensor.
        site.outputs.notes[name]["tangential"] = tangential
        title = message("parts.contact_force_of", "contact force '{name}'", name=name)
        if tangential != "contact":
            title += _FRICTION_REMARKS[tangential]
        balance = (
            MomentumBalance(site, frame, body, other) if tangential == "momentum balance" else None
        )
        columns = axis_names("force", name)
        force = Signal(
            columns,
            ("N",) * 3,
            "force",
            f"force.{name}",
            part=name,
            panel=sensor_panel(title, "force", columns),
            adjust=None if balance is None else balance.with_friction,
        )
        site.outputs.add(f"force.{name}", split.get_output_port(0), force)
        moment = Signal(
            axis_names("moment", name), ("N·m",) * 3, "moment", f"moment.{name}", part=name
        )
        site.outputs.add(f"moment.{name}", split.get_output_port(1), moment)

    def _add_samples(self, builder: DiagramBuilder, name: str, wrench: OutputPort) -> OutputPort:
        """Add the block that samples a wrench (6), and return the port of its result.

        The block is a sample and hold for a sensor without errors, and `MeasuredWrench` for one with errors, such as
        noise. A sensor without a rate has no block: the port is that of the true wrench.

        Args:
            builder: builder of the diagram.
            name: name of the block.
            wrench: port of the true wrench: force [N], then moment [N·m].
        """
        if self.rate is None or not self._has_errors:
            return add_sample_and_hold(builder, name, wrench, self.rate)
        return add_and_connect(builder, name, MeasuredWrench(self, self.rate), wrench)

    def _tangential_source(self, site: Site, shape: GeometryId) -> Tangential:
        """Choose the source of the force along the surfaces (see `Tangential`), for a sensor at a shape."""
        if site.station.engine.reports_friction_of_contacts:
            return "contact"
        plant = site.plant.plant
        inspector = site.plant.scene_graph.model_inspector()
        instance = plant.GetBodyFromFrameId(inspector.GetFrameId(shape)).model_instance()
        bodies = [plant.get_body(index) for index in plant.GetBodyIndices(instance)]
        # On a model that is fixed in the world, an unknown force acts at its base, too.
        is_free = any(body.is_floating_base_body() for body in bodies)
        return "momentum balance" if is_free and self.rate is None else "left out"


class MeasuredWrench(SampledBlock):
    r"""Sample a force and a moment with the errors of a sensor: noise, rounding and a delay.

    .. math:: \hat f_k = \mathrm{round}(f_k + n_k)

    Ports:
        in  ``wrench`` (6): force [N], then moment [N·m].
        out ``wrench`` (6): the same, measured.
    """

    def __init__(self, section: Force, rate: float) -> None:
        """Create the block of a section, with a sampling rate [Hz].

        The rate is that of the section, which is not None here.
        """
        memory = {"wrench": np.zeros(6), "count": np.zeros(1)}
        delay = round(section.delay * rate)
        super().__init__(
            period=1 / rate,
            reads={"wrench": 6},
            memory=memory,
            gives=("wrench",),
            delay=delay,
            at_once=True,
        )
        # One value for each of the three components of the force, then of the moment.
        self._resolution = np.repeat([section.resolution, section.moment_resolution], 3)
        self._noise = np.repeat([section.noise, section.moment_noise], 3)
        self.seed = section.seed

    def sample(self, memory: Named, read: Named) -> Changes:
        """Compute the measured wrench at this sample. The base class delays it.

        Args:
            memory: memory before the sample.
            read: inputs of the block.

        Returns:
            The new values of the memory.
        """
        # The noise of a sample is drawn from its number, so it is the same in every run with the same seed.
        count = int(memory["count"].item())
        noise = self._noise * normal_noise(self.seed, count, 6)
        measured = round_to_resolution(read["wrench"] + noise, self._resolution)
        return {"wrench": measured, "count": count + 1}


def _contacts_port(builder: DiagramBuilder, site: Site) -> OutputPort:
    """Find the port of the plant's contacts. The first call adds the block that reads them for all sensors."""
    # The block of another engine gives contacts that need no reading.
    if site.plant.stand_in is not None:
        return site.plant.stand_in.get_contact_results_output_port()
    if not builder.HasSubsystemNamed(_CONTACTS):
        add_and_connect(
            builder,
            _CONTACTS,
            ContactReader(),
            site.plant.plant_block.get_contact_results_output_port(),
        )
        site.picture.draw_nothing(_CONTACTS)
    return builder.GetSubsystemByName(_CONTACTS).get_output_port()


# Contacts with smaller forces carry no load, and a smaller sum of forces has no direction [N].
_NO_LOAD = 1e-9


class _TimedContacts(NamedTuple):
    """Contacts at many times of a run.

    Attributes:
        contacts: all k contacts, one time after the other.
        rows: index of the time of each contact, shape (k,).
    """

    contacts: Contacts
    rows: npt.NDArray[np.intp]


class MomentumBalance:
    r"""Estimate a sensor's part of the friction on its model, from the model's balance of momentum.

    It is for the scheme ``cenic``, whose contact results only have right forces along the normals. The mean force of
    all contacts on a model over a step of length h is :math:`\bar f = (P_1 - P_0)/h - m g`, with its momentum P at the
    ends of the step. The part of this force that is perpendicular to the normal forces is the friction. A sensor gets
    it in proportion to its share of the normal forces on the model, as the parts of, say, two feet cannot be told
    apart.

    Contacts and momenta, which all sensors need, are computed once and kept in the memo of the run.
    """

    def __init__(
        self,
        site: Site,
        frame: Frame,
        body: Collection[GeometryId],
        other: Collection[GeometryId] | None,
    ) -> None:
        """Prepare the estimate.

        Args:
            site: the station under construction.
            frame: frame in whose axes the sensor gives forces.
            body: shapes of the sensor's body.
            other: shapes that exert the measured force. If it is None, all shapes count but those of the body.
        """
        plant = site.plant.plant
        self._plant = plant
        self._state = site.state
        self._contacts = plant.get_contact_results_output_port()
        self._frame = frame
        self._body = set(body)
        self._other = None if other is None else set(other)

        # All shapes of the model to which the body belongs. The momentum is that of the whole model, in which forces
        # between its own bodies cancel out.
        inspector = site.plant.scene_graph.model_inspector()
        any_shape = next(iter(self._body))
        self._instance = plant.GetBodyFromFrameId(inspector.GetFrameId(any_shape)).model_instance()
        bodies = [plant.get_body(index) for index in plant.GetBodyIndices(self._instance)]
        self._model_shapes = {
            shape for part in bodies for shape in plant.GetCollisionGeometriesForBody(part)
        }

    def with_friction(self, recorded: Recorded, times: Vector, forces: Vector) -> Vector:
        """Add the estimated friction to the sensor's forces along the normals.

        Args:
            recorded: the run.
            times: the times, shape (m,) [s].
            forces: forces along the normals at these times, shape (m, 3) [N], in the sensor's frame.

        Returns:
            The whole forces, shape (m, 3) [N], in the sensor's frame.
        """
        # Without a step there is no change of momentum, and the friction is left out.
        if len(recorded.step_times) < 2:
            return forces
        timed_contacts = self._contacts_at(recorded, times)
        # All sensors at a model need the same forces.
        key = ("contact force", int(self._instance), times.tobytes())
        if key not in recorded.memo:
            recorded.memo[key] = self._mean_contact_forces(recorded, times)
        model_forces: Vector = recorded.memo[key]
        friction = self._friction(model_forces, timed_contacts)

        # Rotations from the sensor's frame to the world at all times.
        rotations = np.empty((len(times), 3, 3))
        context = self._plant.CreateDefaultContext()
        for row, state in enumerate(recorded.sample([self._state], times)[0]):
            self._plant.SetPositionsAndVelocities(context, state)
            rotations[row] = self._frame.CalcPoseInWorld(context).rotation().matrix()
        # R' f for each time.
        return np.asarray(forces + np.einsum("mji,mj->mi", rotations, friction))

    def _contacts_at(self, recorded: Recorded, times: Vector) -> _TimedContacts:
        """Read the contacts at times (m,) [s] of a run. A second call for the same times finds them in its memo."""
        # The bytes of the times: an array cannot be the key of a mapping.
        key = ("contacts", times.tobytes())
        if key not in recorded.memo:
            instants: Sequence[Contacts] = [
                Contacts.of(results) for results in recorded.sample([self._contacts], times)[0]
            ]
            counts = [len(contacts.pairs) for contacts in instants]
            rows = np.repeat(range(len(times)), counts)
            recorded.memo[key] = _TimedContacts(contacts=Contacts.concatenate(instants), rows=rows)
        timed_contacts: _TimedContacts = recorded.memo[key]
        return timed_contacts

    def _friction(self, model_forces: Vector, timed_contacts: _TimedContacts) -> Vector:
        """Compute the sensor's part of the friction at m times, shape (m, 3) [N], in the world's axes.

        Args:
            model_forces: forces of all contacts on the sensor's model, shape (m, 3) [N], in the world's axes.
            timed_contacts: contacts at these times.
        """
        contacts = timed_contacts.contacts

        def sum_by_time(values: Vector) -> Vector:
            """Add up values of contacts (k,) for each time, shape (m,). The sum is 0 at a time without contacts."""
            return np.asarray(
                np.bincount(timed_contacts.rows, values, len(model_forces)), dtype=float
            )

        # Normal forces on the model, and their magnitudes. The sign of a contact is 1 or -1 if its first or second
        # shape belongs to the model, and 0 if none or both do.
        signs = contacts.force_signs(self._model_shapes)
        normal_forces = signs[:, np.newaxis] * contacts.normal_forces
        sizes = np.linalg.norm(normal_forces, axis=1)
        model_load = sum_by_time(sizes)
        # The sign is 0 for contacts that the sensor does not measure.
        sensor_load = sum_by_time(sizes * np.abs(contacts.force_signs(self._body, self._other)))

        # The mean normal n of the contacts of a time, and the force across it: f - (f n) n.
        sums = np.column_stack([sum_by_time(column) for column in normal_forces.T])
        is_loaded = model_load > _NO_LOAD
        lengths = np.linalg.norm(sums, axis=1, keepdims=True)
        # Forces that cancel, such as those of two fingers on a part between them, have no mean normal.
        has_normal = lengths > _NO_LOAD
        normals = np.divide(sums, lengths, out=np.zeros_like(sums), where=has_normal)
        along = (model_forces * normals).sum(axis=1, keepdims=True)
        across = model_forces - along * normals
        # The sensor's share of the friction is its share of the load, as by Coulomb's law with equal coefficients.
        share = np.divide(sensor_load, model_load, out=np.zeros_like(sensor_load), where=is_loaded)
        return np.asarray(share[:, np.newaxis] * across)

    def _mean_contact_forces(self, recorded: Recorded, times: Vector) -> Vector:
        """Compute the mean force of all contacts on the model over the step that contains each time.

        Args:
            recorded: the run.
            times: the times, shape (m,) [s].

        Returns:
            The forces, shape (m, 3) [N], in the world's axes.
        """
        plant = self._plant
        step_times = recorded.step_times
        # Each time is within the step from the index `ends` - 1 to `ends` of the step times; the start of the run
        # belongs to the first step.
        ends = np.clip(np.searchsorted(step_times, times, side="left"), 1, len(step_times) - 1)
        # The momenta are only computed at the ends of these steps; the other entries of the array are not read.
        needed = np.unique(np.append(ends, ends - 1))
        (states,) = recorded.sample([self._state], step_times[needed])

        context = plant.CreateDefaultContext()
        momenta = np.empty((len(step_times), 3))
        for index, state in zip(needed, states, strict=True):
            plant.SetPositionsAndVelocities(context, state)
            momentum = plant.CalcSpatialMomentumInWorldAboutPoint(
                context, [self._instance], np.zeros(3)
            )
            momenta[index] = momentum.translational()

        # f = (P1 - P0) / h - m g
        durations = (step_times[ends] - step_times[ends - 1])[:, np.newaxis]
        rates = (momenta[ends] - momenta[ends - 1]) / durations
        # The weight m g, which the contacts carry in addition to what changes the momentum.
        weight = (
            plant.CalcTotalMass(context, [self._instance]) * plant.gravity_field().gravity_vector()
        )
        return np.asarray(rates - weight)
