"""How the engine's inner loops are compiled: without the interpreter lock, without checks, without reference counts."""

from __future__ import annotations

from functools import partial

from numba import njit

#: For kernels that make arrays. Divisions by zero give infinities and nans, as in numpy, and nothing is raised.
allocating_kernel = partial(njit, cache=True, nogil=True, error_model="numpy")

#: For kernels that make no arrays. numba would count references to each array at each call, by atomic operations that
#: took a fifth of the engine's time; without its memory manager there are none.
kernel = partial(allocating_kernel, _nrt=False)
