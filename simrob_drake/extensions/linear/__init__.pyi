from .linearization import linearize as linearize
from .model import LinearModel as LinearModel
from .model import Mode as Mode
