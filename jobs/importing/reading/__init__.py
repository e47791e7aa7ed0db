"""What the readers of model files share.

Read in this order:

    source_scene    what a reader hands over: meshes as the file has them, their placements, unit and up axis
    defects         what can be wrong with a model, and how often it is
    content         the bytes of a file, read as they are asked for
    resources       the other files that a model file names: only those inside its own folder
    words           names in text, and references to other files
    numbers         numbers in text
    corners         corners of faces become triangles and vertices
    polygons        polygons become triangles that cover what their outlines enclose
    equal_rows      rows of an array that are equal
    vertex_colours  materials and textures become vertex colours
    texture_alpha   the alpha of a texture over whole triangles: least, mean, greatest
    see_through     which triangles can be seen through
    blended         the same for formats that know one kind of alpha only
    needs           what readers need of memory
"""
