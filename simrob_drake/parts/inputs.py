"""The input ports of a station by name, with errors that name the remedy."""

from collections.abc import Iterable
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

    def __init__(self, prefixes: Iterable[str] = ()) -> None:
        """Create the mapping, without inputs.

        Args:
            prefixes: prefixes of the names of the dynamic robots, which may have the inputs `LISTABLE`.
        """
        super().__init__()
        # Only dynamic robots can have these inputs: for others an error must not propose them.
        self._listable = {f"{prefix}{key}": key for prefix in prefixes for key in LISTABLE}

    def __missing__(self, name: object) -> NoReturn:
        """Raise the error of a name that is not in the mapping.

        Raises:
            UnknownKey: always. It is a KeyError, too.
        """
        # The nearest name may be that of an input that the station does not have, since it does not list it.
        what = message("parts.input", "input")
        listable = {
            full_name: key for full_name, key in self._listable.items() if full_name not in self
        }
        close = nearest_name(name, [*self, *listable])
        if close not in listable:
            # The error proposes the nearest name among the inputs that the station has.
            raise UnknownKey(what, name, self)
        remedy = message(
            "parts.list_the_input",
            "; the input '{input}' exists if the key inputs of the station lists it, as in "
            'overrides={{"inputs": ["{key}"]}}',
            input=close,
            key=listable[close],
        )
        raise UnknownKey(what, name, (), remedy=remedy)
