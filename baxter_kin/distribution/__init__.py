"""The distribution that this is part of: its version, and packages that only some of it needs."""
