"""Make published URDFs run: resolve, convert, repair and check them, and tell all that was done."""
