"""What a build may be asked for, group by group: parameters with their units and checks, and the options that set them.

Read in this order:

    sections     what a group is, and its options as `--help` shows them
    view_space   where the viewer may be
    splitting    how the octree of view cells is split
    visibility   how what can be seen is found
    screen       how large an error may look
    objects      what is drawn or left out as a whole
    model_files  what the input files do not say
    stored       how what was found is written
    groups       all of these in one: a new group is its own file, and an import and a base class here
    running      where tasks run, and what is told of them

Light to import: help comes at once.
"""
