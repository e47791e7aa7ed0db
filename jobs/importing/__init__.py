"""Model files to parts: meshes without defects, each with one or more placements.

Read in this order:

    model      the imported model: what the rest of the job works on; `import_model` makes one from files
    saved      how it lies on disk, and how it is written
    spool      meshes that wait on disk until all are known
    read       which reader reads which file; every failure becomes one clear ModelError
    scene      what a reader hands over: meshes as the file has them, placements, unit and up axis
    gltf_file, obj_file, ply_file, stl_file, off_file, dae_file   the readers (OBJ: and obj_materials)
    numbers, corners   what the readers share: numbers in text, vertices out of corners of faces
    content    the bytes of a file, read as they are asked for
    resources  the other files that a model file names: only those inside its own folder
    colours    materials and textures become vertex colours
    join       scenes of several files become one, in the first one's frame
    repair     defects are removed and counted
"""
