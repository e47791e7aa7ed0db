"""The kinds of model files that are read.

Read in this order:

    format           all that the import must know of a kind of file
    known            the list of all kinds: a new one is its own file and one line here
    off_file         OFF
    stl_file         STL: the shortest reader, to learn from
    ply_file         PLY
    gltf/            glTF and GLB: meshes are read one by one
    obj_file         OBJ: in chunks of lines
    obj_materials    its material libraries
    dae_file         COLLADA
    dae_transforms   the transforms of its nodes
    dae_controllers  its skins and morphs
"""
