"""How `scripts/build_body.py` makes the robot's body, in steps; all lengths in millimetres.

`meshes` reads Rethink's files, `openings` and `filling` close what is hollow, `wrapping` puts a
closed surface around it, `collapse` thins that out within an `envelope`, `convex` cuts it into
convex pieces, `hands` says where to cut fingers, `pairs` which links need no check, `packing`
writes the file, `measuring` tells how good it is.
"""
