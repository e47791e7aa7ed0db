"""The upkeep of finished stores: what nobody needs goes, what is damaged is mended.

Read in this order:

    folder     the store's directory, and keeping others out of it
    garbage    `vlod gc`: versions that are not kept, and what no kept version needs
    rebuilt    shards of a version made again from the model
    repair     `vlod verify --repair`: what is bad or missing, made again or copied
"""
