"""XML-RPC: how nodes and the master agree on who is connected to whom."""
