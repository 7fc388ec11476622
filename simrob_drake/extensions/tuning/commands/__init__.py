"""The commands `simrob sweep`, `tune`, `dashboard`, `prove` and `pushes`."""
