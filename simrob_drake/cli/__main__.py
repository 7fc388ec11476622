"""``python -m simrob_drake.cli`` does what ``simrob`` does."""

from simrob_drake.cli import main

main()
