"""glTF 2.0 (.glb, .gltf): meshes are read one by one, as their nodes pose them.

Read in this order:

    header         the JSON header and the binary chunk, and which extensions may be required
    accessors      arrays of numbers out of buffers: strided, normalised, sparse, compressed
    meshopt_views  buffer views under EXT_meshopt_compression and KHR_meshopt_compression
    draco          primitives under KHR_draco_mesh_compression
    draco_process  the process that decodes them: damaged streams crash the decoder, not the import
    poses          where nodes stand: transforms, morph weights, skins, and first frames where there is no rest pose
    textures       images, wrap modes, and where they lie on a primitive
    surfaces       materials become colours and alpha of vertices
    primitives     one primitive: its triangles, morphed, skinned and coloured
    placements     the node tree multiplied out, instances included
    gltf_file      the reader
"""
