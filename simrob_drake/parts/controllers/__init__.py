"""Loops around the servos: the kinds of controller that a station file can name."""

from typing import Annotated

from pydantic import Field

from simrob_drake.parts.controllers.own import OwnController

ControllerConfig = Annotated[OwnController, Field()]
Controllers = dict[str, ControllerConfig]
