"""Amounts of bytes as people write them, read in one way everywhere: options, errors, documents."""

from __future__ import annotations

import math
import re
from typing import Any

import click

from storage.base.errors import ParameterError

_AMOUNT = re.compile(r"([0-9]*\.?[0-9]+)\s*([KMGT]?)(I?)B?", re.IGNORECASE)


def parse_size(text: str) -> int:
    """Bytes of an amount such as 2GiB, 1500MB, 1.5G or 800000000. KiB, MiB ... are powers of 1024, KB, K ... of 1000.

    Raises ParameterError for what is no amount, or none above zero.
    """
    match = _AMOUNT.fullmatch(text.strip())
    size = 0
    if match is not None:
        number, prefix, binary = match.groups()
        size = int(float(number) * (1024 if binary else 1000) ** " KMGT".index(prefix.upper() or " "))
    if size <= 0:
        raise ParameterError(f"{text!r} is no amount of bytes: expected one such as 2GiB or 1500MB")
    return size


def format_size(size: int) -> str:
    """An amount of bytes for people, in bytes, KiB, MiB or GiB, rounded up: as `parse_size` reads it."""
    if size < 1 << 10:
        return f"{size}B"
    if size < 1 << 20:
        return f"{math.ceil(size / (1 << 10))}KiB"
    if size < 1 << 30:
        return f"{math.ceil(size / (1 << 20))}MiB"
    return f"{math.ceil(size / (1 << 30) * 10) / 10:.1f}".removesuffix(".0") + "GiB"


class Bytes(click.ParamType):
    """An option's value: an amount of bytes, as `parse_size` reads it."""

    name = "BYTES"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:  # noqa: ARG002
        """See `click.ParamType.convert`. Raises ParameterError, which names the option."""
        if isinstance(value, int):
            return value
        try:
            return parse_size(str(value))
        except ParameterError as error:
            raise ParameterError(f"{param.opts[-1] if param else self.name}: {error}") from None
