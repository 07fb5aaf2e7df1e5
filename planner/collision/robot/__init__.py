"""The robot's own shapes: its links as meshes and pieces, its hands, the pairs that may touch."""
