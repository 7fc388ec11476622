"""RAPID, the language of ABB's robots, read into programs and written from them; URScript, written."""
