"""What makes the site of ``docs/``: pages of reference from the code, links that leave the folder, both languages."""
