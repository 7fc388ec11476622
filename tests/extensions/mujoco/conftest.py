import pytest

pytest.importorskip("mujoco", reason="installed with the extra mujoco")
