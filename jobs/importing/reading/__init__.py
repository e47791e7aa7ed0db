"""What the readers of model files share.

Read in this order:

    source_scene    what a reader hands over: meshes as the file has them, their placements, unit and up axis
    defects         what can be wrong with a model, and how often it is
    content         the bytes of a file, read as they are asked for
    resources       the other files that a model file names: only those inside its own folder
    text/           words and numbers in text
    equal_rows      rows of an array that are equal
    faces/          faces become triangles and vertices
    vertex_colours  materials and textures become vertex colours
    texture_alpha   the alpha of a texture over whole triangles: least, mean, greatest
    see_through     which triangles can be seen through
    blended         the same for formats that know one kind of alpha only
    needs           what readers need of memory
"""
