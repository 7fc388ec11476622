"""The input ports of a station by name, with errors that name the remedy."""

from typing import NoReturn

from pydrake.systems.framework import InputPort

from simrob_drake.base.errors import UnknownKey, nearest_name
from simrob_drake.base.messages import message

LISTABLE = ("feedforward", "reference_velocity", "external_force", "external_torque")
"""Inputs of a dynamic robot that a station has only if its key ``inputs`` lists them."""


class InputPorts(dict[str, InputPort]):
    """Input ports of a station: a dict whose errors propose the nearest name, and how to get an input that is missing.

    Names are ``reference`` (n) and what the station lists under ``inputs``; with several robots they begin with
    ``<robot>.``.
    """

    def __missing__(self, name: object) -> NoReturn:
        """Raise the error of a name that is not in the mapping.

        Raises:
            UnknownKey: always. It is a KeyError, too.
        """
        what = message("parts.input", "input")
        # The inputs that this station could have: those of each robot of a dynamic station, with its prefix.
        references = [key for key in self if key.rpartition(".")[2] == "reference"]
        is_kinematic = any(key.rpartition(".")[2] == "reference_acceleration" for key in self)
        prefixes = [] if is_kinematic else [key.removesuffix("reference") for key in references]
        listable = {f"{prefix}{key}": key for prefix in prefixes for key in LISTABLE}
        close = nearest_name(name, [*self, *listable])
        if close not in listable:
            raise UnknownKey(what, name, self)
        remedy = message(
            "parts.list_the_input",
            "; the input '{input}' is there if the key inputs of the station lists it, as in "
            'overrides={{"inputs": ["{key}"]}}',
            input=close,
            key=listable[close],
        )
        raise UnknownKey(what, name, (), remedy=remedy)
