"""Measurements of speed and memory: ``make bench``. They are printed, never asserted on."""
