"""The parts of a station, one kind a class: what its YAML says, its checks, its wiring, and what each output is.

A kind is a class of one of the families ``sensors``, ``monitors``, ``references``, ``forces``, ``couplings`` and
``controllers``: a section of the station's file, checked as such. The family's base says which methods a kind has, and
one that lacks one cannot be made; sensors, monitors and controllers are imported when a station names them, by the
family's table ``KINDS``.
"""
