"""A station whose plant MuJoCo steps: the model that is made of it, and the block that stands for it."""
