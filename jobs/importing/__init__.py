"""Model files to parts: meshes without defects, each with one or more placements.

Read in this order:

    model          the imported model: what the rest of the job works on; `import_model` makes one from files
    keeping/       what is kept of a model on disk, while it is imported and after
    read           which files are read, and each by its reader; every failure becomes one clear ModelError
    formats/       the readers, one file for each format, and the list of them
    reading/       what readers share
    join           scenes of several files become one, in the first one's frame
    two_kinds      opaque triangles and those that can be seen through share no vertex
    repair         defects are removed and counted
    inputs         which files a model consists of, and a key of their content
    import_memory  how much memory an import takes, before it is begun
"""
