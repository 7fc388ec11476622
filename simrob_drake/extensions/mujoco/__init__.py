"""Stations in MuJoCo, a second engine: as MJCF files, in quick roll-outs, and beside Drake's runs."""
