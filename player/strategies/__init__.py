"""Culling strategies: strategy (what one is), vlod (precomputed), frustum (at run time), none (everything)."""
