"""The renderer: context (what OpenGL can do), arena (where meshes lie), instances (where they stand), facets (which
parts of meshes turn their backs), draw_list (what to draw), surfaces and shaders (how), target (into what), text (over
it), renderer (all of it together).
"""
