"""Sockets, and the one thread that waits for all of a node's."""
