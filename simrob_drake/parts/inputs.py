"""The input ports of a station by name, with errors that name the remedy."""

from collections.abc import Iterable
from typing import NoReturn

from pydrake.systems.framework import InputPort

from simrob_drake.base.errors import UnknownKey, nearest_name
from simrob_drake.base.messages import message

LISTABLE = ("feedforward", "reference_velocity", "external_force", "external_torque")
"""Inputs of a dynamic robot that the key ``inputs`` of its station can list.

A robot also has such an input without that key if its servo or a controller needs it, or if a block of the user's own
drives it. Only robots with a tool have inputs of external forces and torques."""


class InputPorts(dict[str, InputPort]):
    """Input ports of a station: a dict whose errors propose the nearest name, and how to get an input that is missing.

    Each robot has the input ``reference`` (n). A robot of a kinematic station also has ``reference_velocity`` and
    ``reference_acceleration``. A dynamic robot also has the inputs that the station lists under ``inputs``, and those
    that its servo, a controller or a block of the user's own needs. With several robots, these names begin with
    ``<robot>.``. Only robots with a tool have inputs of external forces and torques. There can also be inputs of axes
    whose motion is prescribed, ``prescribed.<axis>``, and of signal flows, ``<flow>.<block>``.
    """

    def __init__(self, prefixes: Iterable[str] = ()) -> None:
        """Create the mapping, without inputs.

        Args:
            prefixes: prefixes of the names of the dynamic robots, which may have the inputs `LISTABLE`.
        """
        super().__init__()
        # The key of an input by its full name, with the prefix of the robot. Only dynamic robots can have these inputs:
        # for others an error must not propose them.
        self._listable = {f"{prefix}{key}": key for prefix in prefixes for key in LISTABLE}

    def __missing__(self, name: object) -> NoReturn:
        """Raise the error of a name that is not in the mapping. It proposes the nearest name, or lists the known ones.

        Raises:
            UnknownKey: always. It is a KeyError, too.
        """
        # The nearest name, if any is similar, may be that of an input that the station could have, but does not list.
        what = message("parts.input", "input")
        listable = {
            full_name: key for full_name, key in self._listable.items() if full_name not in self
        }
        close = nearest_name(name, [*self, *listable])
        if close not in listable:
            # The error proposes the nearest name among the inputs that the station has.
            raise UnknownKey(what, name, self)
        # The error proposes to list the input.
        remedy = message(
            "parts.list_the_input",
            "; the input '{input}' exists if the key inputs of the station lists it, as in "
            'overrides={{"inputs": ["{key}"]}}',
            input=close,
            key=listable[close],
        )
        raise UnknownKey(what, name, (), remedy=remedy)
