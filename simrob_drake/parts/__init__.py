"""The parts of a station, one kind a class: what its YAML says, its checks, its wiring, and what each output is.

A kind is a class of one of the families ``sensors``, ``monitors``, ``references``, ``forces``, ``couplings`` and
``controllers``: a section of the station's file, checked as such. The family's base class declares the methods of a
kind; a class that lacks an abstract one cannot be instantiated. Sensors, monitors and controllers are imported when a
station names them, by the family's table ``KINDS``.
"""
