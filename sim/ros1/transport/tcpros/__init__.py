"""TCPROS: how messages, requests and responses travel."""
