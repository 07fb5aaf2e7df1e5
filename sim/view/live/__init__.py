"""The live view: what happens, in the browser, while it happens."""
