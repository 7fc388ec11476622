"""Stations: typed configurations, and the functions that wire them into closed Drake Diagrams."""
