"""How `scripts/build_body.py` makes the robot's body, in steps; all lengths in millimetres.

`meshes` reads Rethink's files, `thinning` makes their triangles fewer, `covering` puts convex
pieces around them; `openings` and `filling` close what is hollow, `enclosing` wraps it; `hands`
says where to cut fingers, `convex` makes the pieces, `pairs` finds which links need no check,
`packing` writes the file, `measuring` tells how far triangles are from others.
"""
