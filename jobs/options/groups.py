"""All groups of parameters that a build's tasks are made from: a new one is an import and a base class here."""

from __future__ import annotations

import sys
from dataclasses import dataclass

from jobs.options.model_files import ModelFileParameters
from jobs.options.objects import ObjectParameters
from jobs.options.screen import ScreenParameters
from jobs.options.sections import Group, Section
from jobs.options.splitting import SplittingParameters
from jobs.options.stored import StoredParameters
from jobs.options.view_space import ViewSpaceParameters
from jobs.options.visibility import VisibilityParameters


@dataclass(frozen=True)
class GroupedParameters(
    ViewSpaceParameters,
    SplittingParameters,
    VisibilityParameters,
    ScreenParameters,
    ObjectParameters,
    ModelFileParameters,
    StoredParameters,
):
    """The parameters of all groups, in the order in which help shows them."""

    def __post_init__(self) -> None:
        for group in GROUPS:
            group.check(self)


GROUPS: tuple[type[Group], ...] = GroupedParameters.__bases__

#: The options that set them: each group's SECTION lies beside it.
SECTIONS: tuple[Section, ...] = tuple(sys.modules[group.__module__].SECTION for group in GROUPS)
