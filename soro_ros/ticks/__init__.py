"""The work of the nodes, tick by tick, in a node or a replay."""
