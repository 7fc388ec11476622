"""Robot stations as Drake Diagrams: build, control, program and watch robots.

The words of the package: a *station* is a closed Drake Diagram (robots, servos, contacts, sensors, monitors), a
*piece* a work object, tool or load, a *servo* the PID and saturation of one joint, a *reference* the desired joint
positions over time, a *monitor* a block that can end a simulation with a reason.
"""

import lazy_loader

from simrob_drake.former_names import install

install()
__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
