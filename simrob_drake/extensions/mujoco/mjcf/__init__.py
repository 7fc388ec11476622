"""MJCF, the format of MuJoCo: read with what it includes, compiled by MuJoCo, and written as a robot's element."""
