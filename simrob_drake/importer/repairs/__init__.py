"""Stages of an import that mend a robot in place: each tells what it did, and changes nothing the second time."""
