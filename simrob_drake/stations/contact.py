"""Give the shapes of a station's plant the surfaces of its configuration."""

from __future__ import annotations

from itertools import combinations

from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    GeometryId,
    ProximityProperties,
    Role,
    RoleAssign,
    SceneGraph,
    SceneGraphInspector,
)
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant

from simrob_drake.parts.targets import piece_of_shape
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.contact_config import ContactConfig, ContactMaterial
from simrob_drake.stations.contact_limits import check_stiffness
from simrob_drake.stations.resolve import ResolvedStation

MODULUS = 1e7
"""Hydroelastic modulus [Pa] where none is given: stiff rubber."""


def needs_shapes(config: StationConfig) -> bool:
    """Tell whether a station's plant needs collision shapes: for contact, or for the distances of a kinematic one."""
    measured = any(sensor.kind == "distance" for sensor in config.sensors.values())
    return config.contact is not None or (config.mode == "kinematic" and measured)


def apply_materials(plant: MultibodyPlant, scene_graph: SceneGraph, station: ResolvedStation) -> None:
    """Write stiffness, dissipation, friction and modulus into the shapes of a plant.

    The plant is not finalized yet: a shape whose surface is written anew loses its collision filters, and finalizing
    makes those between neighbours.
    """
    config, contact = station.config, station.config.contact
    if contact is None:
        return
    plant.set_stiction_tolerance(contact.stiction_speed)
    source = plant.get_source_id()
    assert source is not None  # add_plant registers the plant
    inspector = scene_graph.model_inspector()
    for shape in inspector.GetAllGeometryIds(Role.kProximity):
        material = _material(config, contact, piece_of_shape(station, inspector, shape))
        properties = ProximityProperties(inspector.GetProximityProperties(shape))
        _write(properties, material, contact)
        scene_graph.AssignRole(source, shape, properties, RoleAssign.kReplace)


def check_stiffnesses(plant: MultibodyPlant, scene_graph: SceneGraph, station: ResolvedStation) -> None:
    """Check that the solver of a station can hold its contacts.

    Raises:
        InvalidParameter: a stiffness that it cannot hold, with the largest that it can.
    """
    config = station.config
    if config.contact is None or config.mode == "kinematic":
        return
    inspector = scene_graph.model_inspector()
    for shape in inspector.GetAllGeometryIds(Role.kProximity):
        body = plant.GetBodyFromFrameId(inspector.GetFrameId(shape))
        stiffness = _material(config, config.contact, piece_of_shape(station, inspector, shape)).stiffness
        if stiffness is not None and not plant.IsAnchored(body):
            check_stiffness(config.solver, body, stiffness)


def pairs_without_surface(plant: MultibodyPlant, inspector: SceneGraphInspector) -> list[str]:
    """Return the pairs of bodies that cannot meet in a hydroelastic surface, since both are rigid."""
    rigid = [shape for shape in inspector.GetAllGeometryIds(Role.kProximity) if _is_rigid(inspector, shape)]
    pairs = set()
    for first, second in combinations(rigid, 2):
        bodies = [plant.GetBodyFromFrameId(inspector.GetFrameId(shape)) for shape in (first, second)]
        if not (inspector.CollisionFiltered(first, second) or all(plant.IsAnchored(body) for body in bodies)):
            pairs.add(" and ".join(sorted(body.scoped_name().get_full() for body in bodies)))
    return sorted(pairs)


def _is_rigid(inspector: SceneGraphInspector, shape: GeometryId) -> bool:
    properties = inspector.GetProximityProperties(shape)
    hydroelastic = properties.HasGroup("hydroelastic") and properties.HasProperty("hydroelastic", "compliance_type")
    return hydroelastic and not properties.HasProperty("hydroelastic", "hydroelastic_modulus")


def _material(config: StationConfig, contact: ContactConfig, piece: str | None) -> ContactMaterial:
    """Return the station's figures, those of the piece in their place."""
    own = config.pieces[piece].contact if piece else None
    given = {} if own is None else own.model_dump(exclude_none=True)
    shared = contact.model_dump(include=set(ContactMaterial.model_fields), exclude_none=True)
    return ContactMaterial.model_validate({**shared, **given})


def _write(properties: ProximityProperties, material: ContactMaterial, contact: ContactConfig) -> None:
    if material.stiffness is not None:
        properties.UpdateProperty("material", "point_contact_stiffness", 2 * material.stiffness)
    if material.dissipation is not None:
        properties.UpdateProperty("material", "hunt_crossley_dissipation", material.dissipation)
    if material.friction is not None:
        friction = CoulombFriction(material.friction.static, material.friction.dynamic)
        properties.UpdateProperty("material", "coulomb_friction", friction)
    known = properties.HasGroup("hydroelastic") and properties.HasProperty("hydroelastic", "compliance_type")
    if contact.model == "point":
        return
    if not known:
        AddCompliantHydroelasticProperties(contact.resolution, material.hydroelastic_modulus or MODULUS, properties)
    elif material.hydroelastic_modulus is not None and properties.HasProperty("hydroelastic", "hydroelastic_modulus"):
        properties.UpdateProperty("hydroelastic", "hydroelastic_modulus", material.hydroelastic_modulus)
