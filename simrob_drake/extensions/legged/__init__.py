"""A robot on legs of which only the tree is known: its limbs, its soles, its figures, and what it can do by them."""
