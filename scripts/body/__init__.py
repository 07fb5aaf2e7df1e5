"""How `scripts/build_body.py` makes the robot's body, in steps; all lengths in millimetres.

`meshes` reads Rethink's files, `thinning` makes their triangles fewer, `pieces` puts convex pieces
around them and writes the file, `hands` says where to cut fingers, `enclosure` wraps what is
hollow, `pairs` finds which links need no check.
"""
