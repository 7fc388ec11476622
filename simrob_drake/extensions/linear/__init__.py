"""Linear models of stations about a posture: poles, Bode plots, and what a design of controllers starts from."""

import lazy_loader

# The names are imported when they are first used: the announcement of the extension must not load Drake.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
