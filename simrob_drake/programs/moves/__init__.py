"""Kinds of moves, one a file: its keys, what it is called, and how arms and legs do it; ``kinds`` lists them."""
