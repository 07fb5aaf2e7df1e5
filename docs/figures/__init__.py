"""Code that draws the figures of the pages."""
