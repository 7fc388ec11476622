"""The contact shapes of a legged robot's feet: spheres or boxes. A robot may have several kinds; a station takes one.

Point contact applies one force for each pair of shapes that touch. A foot therefore needs several spheres to lie flat.
A box is a single shape, so it lies flat only in hydroelastic contact, in which the pressure is spread over the area.
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
    """A box under a foot, with its sides along the axes of the foot's link."""

    size: tuple[Positive, Positive, Positive]
    """Lengths of the sides [m]."""
    centre: Triple
    """Centre of the box in the foot's link [m]."""


class FootSurface(Strict):
    """Radius of a foot's spheres, and the contact properties of its shapes."""

    radius: Positive = 0.01
    """Radius of the spheres [m]."""
    stiffness: Positive = 1.0e5
    """Stiffness k of point contact [N/m]."""
    dissipation: NotNegative = 50.0
    """Dissipation d of Hunt and Crossley's law, f = k x (1 + d ẋ) [s/m]. With the default, a foot does not bounce."""
    hydroelastic_modulus: Positive = 1.0e7
    """Modulus of a sole in hydroelastic contact [Pa]."""
    friction: tuple[NotNegative, NotNegative] = (1.0, 0.9)
    """Static and dynamic coefficient of friction. The defaults are those of the contacts in the Simulink library."""


class FootContact(FootSurface):
    """One kind of feet: all feet have spheres, or all have a box."""

    points: dict[str, tuple[Triple, ...]] = Field(default_factory=dict)
    """Centres of the spheres in the foot's link [m], by link."""
    boxes: dict[str, Sole] = Field(default_factory=dict)
    """Boxes by link."""
    others: dict[str, FootSurface] = Field(default_factory=dict)
    """Values of single links that differ from the rest, such as those of wheels of two sizes, by link. A value that is
    left out is that of the other feet."""

    @model_validator(mode="after")
    def _check_links(self) -> "FootContact":
        """Check that the feet have either spheres or boxes, and that ``others`` names feet only.

        Raises:
            ValueError: both or none of the two are given, or ``others`` names a link that is no foot. Pydantic reports
                the error with the key.
        """
        # Equal truth values mean that both are given or that both are missing.
        if bool(self.points) == bool(self.boxes):
            raise ValueError(
                message("robots.spheres_or_boxes", "feet need either points or boxes, not both")
            )
        strange = self.others.keys() - {*self.links}
        if strange:
            raise ValueError(
                message(
                    "robots.strange_others",
                    "others names {strange}, which are no feet; the feet are {feet}",
                    strange=", ".join(sorted(strange)),
                    feet=", ".join(self.links),
                )
            )
        return self

    @property
    def links(self) -> list[str]:
        """Names of the links that are feet."""
        return [*self.points, *self.boxes]

    def surface(self, link: str) -> FootSurface:
        """Return the radius and the contact properties of one foot.

        Args:
            link: name of the foot's link. Unless it is among ``others``, the values are those of all feet.
        """
        own = self.others.get(link)
        if own is None:
            return self
        # Only the values that the file gives for this foot. Those left out have defaults, which must not count.
        return self.model_copy(update={name: getattr(own, name) for name in own.model_fields_set})

    def support_points(self, link: str) -> Vector:
        """Compute the points on which an upright foot stands, in the frame of its link.

        Args:
            link: name of the foot's link.

        Returns:
            the lowest point of each sphere, or the four lower corners of the box, shape (k, 3) [m].
        """
        # For an upright foot, "below" is along the z axis of its link.
        if link in self.points:
            return np.array(self.points[link]) - (0.0, 0.0, self.surface(link).radius)
        sole = self.boxes[link]
        lower_corners = np.array([(x, y, -1.0) for x in (-1.0, 1.0) for y in (-1.0, 1.0)])
        return np.asarray(sole.centre + lower_corners * np.array(sole.size) / 2)

    def lowest_points(self, link: str, poses: Vector) -> Vector:
        """Compute the points of a foot that may touch the ground, in the world, for a foot that may be tilted.

        Args:
            link: name of the foot's link.
            poses: poses of the link in the world, shape (m, 4, 4).

        Returns:
            the lowest point of each sphere, or the four corners of the box that are the lower ones of an upright foot,
            shape (m, k, 3) [m].
        """
        # The lowest point of a sphere is below its centre, however the foot is tilted.
        if link in self.points:
            own_points = np.array(self.points[link])
            drop = self.surface(link).radius
        else:
            own_points = self.support_points(link)
            drop = 0.0
        # R p for all poses and points. Points are rows, so that they are multiplied with Rᵀ.
        turned = own_points @ poses[:, :3, :3].transpose(0, 2, 1)
        points = poses[:, np.newaxis, :3, 3] + turned
        return np.asarray(points - [0.0, 0.0, drop])


class Feet(Strict):
    """The kinds of feet of a robot."""

    default: str
    """Name of the kind that a station uses unless it names another."""
    contacts: dict[str, FootContact] = Field(min_length=1)
    """Kinds of feet by name."""

    @model_validator(mode="after")
    def _check_default(self) -> "Feet":
        """Check that the default is one of the kinds. Raises ValueError, which pydantic reports with the key."""
        if self.default not in self.contacts:
            raise ValueError(
                message(
                    "robots.unknown_default_contact",
                    "default is '{default}'; it must be one of {contacts}",
                    default=self.default,
                    contacts=", ".join(self.contacts),
                )
            )
        return self

    def kind(self, name: str | None) -> FootContact:
        """Return the contact shapes of a kind of feet by its name, or those of the default one if the name is None.

        Raises:
            UnknownName: there is no such kind.
        """
        if name is None:
            return self.contacts[self.default]
        known_name = one_of(message("robots.kind_of_feet", "kind of feet"), name, self.contacts)
        return self.contacts[known_name]


def put_on_feet(robot: ET.Element, feet: FootContact) -> None:
    """Replace the collision shapes of a robot's feet by contact shapes, in place. Other links keep theirs.

    Args:
        robot: the ``robot`` element of the URDF.
        feet: the contact shapes.

    Raises:
        UnknownName: a link that the robot does not have.
    """
    links = {name_of(link): link for link in robot.iterfind("link")}
    for name in feet.links:
        link = links[one_of(message("robots.link_under_feet", "link (under feet)"), name, links)]
        # The mesh of a foot would touch the ground next to the contact shapes, and count twice.
        for old in link.findall("collision"):
            link.remove(old)
        surface = feet.surface(name)
        if name in feet.boxes:
            sole = feet.boxes[name]
            shape: Box | Sphere = Box(*sole.size)
            centres: tuple[Triple, ...] = (sole.centre,)
        else:
            shape = Sphere(surface.radius)
            centres = feet.points[name]
        solids = [Solid(RigidTransform(np.array(centre)), shape) for centre in centres]
        for number, solid in enumerate(solids):
            collision = add_solid(link, "collision", f"{name}_contact_{number}", solid)
            add_contact(collision, _contact_properties(surface))


def _contact_properties(surface: FootSurface) -> dict[str, float | None]:
    """Make Drake's contact properties of a foot, by their names in Drake.

    A foot gets those of point contact and those of hydroelastic contact. Drake reads the ones that it needs.
    """
    static, dynamic = surface.friction
    return {
        # An element without a value: its presence makes the shape compliant.
        "compliant_hydroelastic": None,
        "point_contact_stiffness": surface.stiffness,
        "hunt_crossley_dissipation": surface.dissipation,
        "mu_static": static,
        "mu_dynamic": dynamic,
        "hydroelastic_modulus": surface.hydroelastic_modulus,
        # Drake divides a sphere into triangles of this size [m]: half the radius keeps it round.
        "mesh_resolution_hint": surface.radius / 2,
    }
