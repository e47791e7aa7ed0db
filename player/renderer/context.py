"""OpenGL contexts: one without a window (EGL), and what a context can do.

moderngl has no call for a depth range of 0 to 1 nor for floating-point depth buffers. Both are needed for reversed
depth, so the three entry points concerned are looked up from the context's own loader. Where that is not possible
(OpenGL before 4.5 without ARB_clip_control, macOS), depth is the usual one with a near plane chosen for the model.
"""

from __future__ import annotations

import ctypes
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import moderngl

from player.errors import GraphicsError
from storage.base.errors import MissingDependencyError

_LOWER_LEFT = 0x8CA1
_ZERO_TO_ONE = 0x935F
_NEGATIVE_ONE_TO_ONE = 0x935E
_RENDERBUFFER = 0x8D41
_DEPTH_COMPONENT32F = 0x8CAC


@dataclass(frozen=True)
class Abilities:
    """What the renderer makes use of in a context."""

    renderer: str  # the driver's name for the device
    version: int  # OpenGL version times 100, such as 450
    multi_draw: bool  # multi-draw indirect with base instance: OpenGL 4.3
    reversed_depth: bool  # depth from 1 (near) to 0 (infinitely far) in floating point


class _EntryPoints:
    """The OpenGL calls that moderngl does not offer."""

    def __init__(self, context: moderngl.Context) -> None:
        load = context.mglo._context.load_opengl_function

        def entry(name: str, *arguments: type) -> Any:
            address = load(name)
            if not address:
                raise LookupError(name)
            return ctypes.CFUNCTYPE(None, *arguments)(address)

        number = ctypes.c_uint
        self.clip_control = entry("glClipControl", number, number)
        self.bind_renderbuffer = entry("glBindRenderbuffer", number, number)
        self.renderbuffer_storage = entry(
            "glRenderbufferStorageMultisample", number, ctypes.c_int, number, ctypes.c_int, ctypes.c_int
        )


def _entry_points(context: moderngl.Context) -> _EntryPoints | None:
    """The context's entry points, looked up once; None where it has no clip control."""
    if context.extra is None:  # moderngl leaves this attribute to its users
        found: _EntryPoints | None = None
        if context.version_code >= 450 or "GL_ARB_clip_control" in context.extensions:
            with suppress(AttributeError, LookupError, OSError):
                found = _EntryPoints(context)
        context.extra = (found,)
    entries: _EntryPoints | None = context.extra[0]
    return entries


def abilities(context: moderngl.Context, *, force_gl33: bool = False, force_plain_depth: bool = False) -> Abilities:
    """What `context` can do; the two switches make a newer driver behave like an older one, for tests."""
    return Abilities(
        renderer=str(context.info["GL_RENDERER"]),
        version=int(context.version_code),
        multi_draw=not force_gl33 and context.version_code >= 430,
        reversed_depth=not force_gl33 and not force_plain_depth and _entry_points(context) is not None,
    )


def use_depth_range(context: moderngl.Context, *, reversed_depth: bool) -> None:
    """Sets the range of clip-space depth: 0 to 1 for reversed depth, OpenGL's -1 to 1 otherwise."""
    entries = _entry_points(context)
    if entries is not None:
        entries.clip_control(_LOWER_LEFT, _ZERO_TO_ONE if reversed_depth else _NEGATIVE_ONE_TO_ONE)


def depth_buffer(
    context: moderngl.Context, size: tuple[int, int], *, samples: int, reversed_depth: bool
) -> moderngl.Renderbuffer:
    """A depth buffer of `size` pixels: 32-bit floating point for reversed depth, else 24-bit integers."""
    buffer = context.depth_renderbuffer(size, samples=samples)
    entries = _entry_points(context) if reversed_depth else None
    if entries is not None:
        entries.bind_renderbuffer(_RENDERBUFFER, buffer.glo)
        entries.renderbuffer_storage(_RENDERBUFFER, samples, _DEPTH_COMPONENT32F, *size)
        entries.bind_renderbuffer(_RENDERBUFFER, 0)
    return buffer


def headless_context() -> moderngl.Context:
    """A new OpenGL 3.3 or newer context without a window, through EGL. Raises GraphicsError with the cure."""
    cure = "install Mesa's software driver (Debian, Ubuntu: apt-get install libegl1 libgl1-mesa-dri) and try again"
    try:
        settings: dict[str, Any] = {"backend": "egl", "require": 330}
        return moderngl.create_standalone_context(**settings)
    except ImportError as error:
        raise MissingDependencyError(
            f"drawing without a window needs glcontext's EGL backend ({error}): {cure}"
        ) from None
    except Exception as error:  # moderngl and glcontext raise plain Exception
        raise GraphicsError(f"no OpenGL 3.3 context without a window ({_one_line(error)}): {cure}") from None


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__
