"""What demo scenes are made of.

Read in this order:

    solids        closed shapes as arrays
    glb           binary glTF, written while a scene is being made
    draft         a scene in the making: palette, stock, a budget of triangles
    furnishings   the stock of rooms
    equipment     the stock of plants
    street        the stock of streets and roofs
    rooms         rooms along a corridor
    arrangements  what may stand where in a room
    furnish       what does, as far as the triangles last
"""
