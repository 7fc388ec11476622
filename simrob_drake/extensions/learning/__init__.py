"""Learn: environments of Gymnasium made of stations, and policies as ONNX files.

Importing this registers ``simrob/Walk-v0``, ``simrob/Reach-v0``, ``simrob/HandGuide-v0`` and ``simrob/Balance-v0``.
"""

from simrob_drake.extensions.learning.registration import ENVIRONMENTS as ENVIRONMENTS
from simrob_drake.extensions.learning.registration import register_with_gymnasium

register_with_gymnasium()
