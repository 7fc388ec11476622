"""Our own extensions: what the toolbox can do beyond stations, runs and programs. The core works without them."""
