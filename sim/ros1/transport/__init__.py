"""How a node reaches others: XML-RPC for agreements, TCPROS for messages and services.

One thread waits for all sockets of a node. What may take long, as looking up a host's name, has a
thread of its own while it lasts.
"""
