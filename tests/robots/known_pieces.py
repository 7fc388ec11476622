"""The pieces of the package, with all their figures."""

from simrob_drake.robots.pieces import PieceModel, described_piece, piece_file, with_mass_properties


def load_piece(name: str) -> PieceModel:
    """Return a piece of the package by its name."""
    return with_mass_properties(described_piece(piece_file(name)))
