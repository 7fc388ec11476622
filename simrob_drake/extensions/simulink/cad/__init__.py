"""Assemblies as CAD tools export them for Simscape Multibody, as models of its blocks."""
