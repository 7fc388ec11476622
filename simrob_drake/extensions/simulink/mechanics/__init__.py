"""Simscape Multibody blocks as rigid bodies, joints and contacts."""
