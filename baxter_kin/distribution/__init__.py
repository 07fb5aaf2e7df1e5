"""The distribution: its version, and its optional packages."""
