"""How models are parted into pieces and simplified."""

from __future__ import annotations

from dataclasses import dataclass, field

from jobs.objects.object_options import Limits
from storage.base.errors import ParameterError


@dataclass(frozen=True)
class DetailOptions:
    """What decides pieces and levels."""

    partition: Limits = field(default_factory=Limits)
    crease_angle: float = 40.0  # edges with a sharper angle between their faces' normals stay hard, in degrees

    def __post_init__(self) -> None:
        if not 0.0 <= self.crease_angle <= 180.0:
            raise ParameterError(f"crease_angle must be from 0 to 180 degrees, not {self.crease_angle}")
