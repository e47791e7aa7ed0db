"""Files of a store: how bytes are kept, checked and found again, whatever they say.

Read in this order:
    shards         immutable files of checksummed frames, written and read
    columns        tables and lists of names as frames
    files          where files are read from: a folder, a server, memory
    disk_cache     what came from far away, on a disk within a budget of bytes
    cache          what was decoded last, within a budget of bytes
    shard_files    the shards of a store where its files are
    sections       what the manifest says of model, geometry and cells
    manifest       versions, and what makes a directory a store
"""
