"""Learn: environments of Gymnasium made of stations, and policies as ONNX files.

Importing this registers ``simrob/Walk-v0``, ``simrob/Reach-v0``, ``simrob/HandGuide-v0`` and ``simrob/Balance-v0``.
"""

from simrob_drake.base.extras import needed

ENVIRONMENTS = {"Walk": "walk", "Reach": "reach", "HandGuide": "hand_guide", "Balance": "balance"}
"""The tasks of the environments, by the names in their ids."""

with needed("learning", "rl"):
    import gymnasium

for _name, _task in ENVIRONMENTS.items():
    gymnasium.register(
        f"simrob/{_name}-v0",
        entry_point="simrob_drake.extensions.learning.environment:StationEnvironment",
        vector_entry_point="simrob_drake.extensions.learning.vector:StationVectorEnvironment",
        kwargs={"task": _task},
    )
