"""What a legged robot stands on: contact spheres or sole boxes, of which a station chooses one kind.

Spheres are contact proxies: point contact pushes once for each pair of shapes, so a foot needs several to lie flat.
A box is one shape, and lies flat in hydroelastic contact alone.
"""

import xml.etree.ElementTree as ET

import numpy as np
from pydantic import Field, model_validator
from pydrake.geometry import Box, Sphere
from pydrake.math import RigidTransform

from simrob_drake.base.errors import one_of
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.base.sections import NotNegative, Positive, Strict, Triple
from simrob_drake.robots.urdf import Solid, add_contact, add_solid, name_of


class Sole(Strict):
    """A box under a foot."""

    size: tuple[Positive, Positive, Positive]
    """Lengths along the axes of the foot's link [m]."""
    centre: Triple
    """Its middle in the foot's link [m]."""


class FootSurface(Strict):
    """How large the spheres of feet are, and what happens where they touch."""

    radius: Positive = 0.01
    """Of the spheres [m]."""
    stiffness: Positive = 1.0e5
    """Of point contact [N/m]."""
    dissipation: NotNegative = 50.0
    """Of Hunt and Crossley's law, f = k x (1 + d ẋ) [s/m]: such that a foot does not bounce."""
    hydroelastic_modulus: Positive = 1.0e7
    """Of a sole in hydroelastic contact [Pa]."""
    friction: tuple[NotNegative, NotNegative] = (1.0, 0.9)
    """Static and dynamic coefficient; those of the contacts in the Simulink library."""


class FootContact(FootSurface):
    """One kind of feet: spheres about points of the feet's links, or a box each."""

    points: dict[str, tuple[Triple, ...]] = Field(default_factory=dict)
    """Middles of the spheres, by link [m]."""
    boxes: dict[str, Sole] = Field(default_factory=dict)
    """Soles by link."""
    others: dict[str, FootSurface] = Field(default_factory=dict)
    """Figures of links that differ, as wheels of two sizes do; what one leaves out is as for the rest."""

    @model_validator(mode="after")
    def _one_kind(self) -> "FootContact":
        if bool(self.points) == bool(self.boxes):
            raise ValueError(message("robots.spheres_or_boxes", "feet are either spheres about points, or boxes"))
        if strange := self.others.keys() - {*self.links}:
            raise ValueError(
                message(
                    "robots.strange_others",
                    "others has {strange}; the feet are {feet}",
                    strange=", ".join(sorted(strange)),
                    feet=", ".join(self.links),
                )
            )
        return self

    @property
    def links(self) -> list[str]:
        """The links that are feet."""
        return [*self.points, *self.boxes]

    def surface(self, link: str) -> FootSurface:
        """Return what a foot touches with."""
        if (own := self.others.get(link)) is None:
            return self
        return self.model_copy(update={name: getattr(own, name) for name in own.model_fields_set})

    def support_points(self, link: str) -> Vector:
        """Return the lowest points of a foot's shapes while its link stands upright, shape (k, 3) [m], in its frame."""
        if link in self.points:
            return np.array(self.points[link]) - (0.0, 0.0, self.surface(link).radius)
        sole = self.boxes[link]
        corners = np.array([(x, y, -1.0) for x in (-1.0, 1.0) for y in (-1.0, 1.0)])
        return np.asarray(sole.centre + corners * np.array(sole.size) / 2)

    def lowest_points(self, link: str, poses: Vector) -> Vector:
        """Return the lowest points of a foot's spheres or sole in the world (m, k, 3) [m], its link at (m, 4, 4)."""
        under = self.surface(link).radius if link in self.points else 0.0
        own = np.array(self.points[link]) if link in self.points else self.support_points(link)
        points = poses[:, np.newaxis, :3, 3] + own @ poses[:, :3, :3].transpose(0, 2, 1)
        return np.asarray(points - [0.0, 0.0, under])


class Feet(Strict):
    """The kinds of feet that a robot has."""

    default: str
    """The kind that a station takes unless it names another."""
    contacts: dict[str, FootContact] = Field(min_length=1)
    """The kinds by name."""

    @model_validator(mode="after")
    def _default_is_one(self) -> "Feet":
        if self.default not in self.contacts:
            raise ValueError(
                message(
                    "robots.unknown_default_contact",
                    "default '{default}' is none of {contacts}",
                    default=self.default,
                    contacts=", ".join(self.contacts),
                )
            )
        return self

    def kind(self, name: str | None) -> FootContact:
        """Return a kind of feet by its name, or the default one; raises UnknownName: there is no such kind."""
        return self.contacts[
            self.default
            if name is None
            else one_of(message("robots.kind_of_feet", "kind of feet"), name, self.contacts)
        ]


def put_on_feet(robot: ET.Element, feet: FootContact) -> None:
    """Give the feet of a robot, in place, their contact shapes instead of what collision shapes they have.

    Raises:
        UnknownName: a link that the robot does not have.
    """
    links = {name_of(link): link for link in robot.iterfind("link")}
    for name in feet.links:
        link = links[one_of(message("robots.link_under_feet", "link (under feet)"), name, links)]
        for old in link.findall("collision"):
            link.remove(old)
        surface = feet.surface(name)
        sphere = Sphere(surface.radius)
        solids = [Solid(RigidTransform(np.array(point)), sphere) for point in feet.points.get(name, ())]
        if name in feet.boxes:
            sole = feet.boxes[name]
            solids = [Solid(RigidTransform(np.array(sole.centre)), Box(*sole.size))]
        for number, solid in enumerate(solids):
            add_contact(add_solid(link, "collision", f"{name}_contact_{number}", solid), _contact_properties(surface))


def _contact_properties(feet: FootSurface) -> dict[str, float | None]:
    """Return Drake's contact figures; those of point and of hydroelastic contact do not disturb each other."""
    static, dynamic = feet.friction
    return {
        "compliant_hydroelastic": None,
        "point_contact_stiffness": feet.stiffness,
        "hunt_crossley_dissipation": feet.dissipation,
        "mu_static": static,
        "mu_dynamic": dynamic,
        "hydroelastic_modulus": feet.hydroelastic_modulus,
        "mesh_resolution_hint": feet.radius / 2,
    }
