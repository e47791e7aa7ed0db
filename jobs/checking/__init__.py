"""Checking finished stores, with code that shares nothing with what made them where it can.

Read in this order:

    verify      the parts of a check, one after the other
    findings    what was found, and the report of it
    workers     functions on one store, on all cores: in this process as long as that is quick
    checksums   every byte against the checksums that name the shards; see-through against alpha
    sets        every cell's vLOD against its cut and the table of cells
    detail      the cut of a cell: the whole model, fine enough
    turned      which triangles of a cell's vLOD are not drawn, being turned away
    rays        rays from sampled cells
    cut_oracle  what they can meet: the cell's cut, in portions that fit into memory
    oracle      what they meet, and whether that stands up in double precision
"""
