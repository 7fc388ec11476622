"""The parts of a station, one kind a file: what its YAML says, its checks, its wiring, and what each output is.

A kind is a class of one of the families ``sensors``, ``monitors``, ``references``, ``forces`` and ``controllers``: a
section of the station's file, checked as such. Its methods are called on the family's union, so that a kind that lacks
one fails the type check; at run time a kind is imported when a station names it, by the family's table ``KINDS``.
"""
