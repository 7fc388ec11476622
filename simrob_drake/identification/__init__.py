"""Figures of stations found from measurements: stiffness and dissipation of a contact from bounces."""
