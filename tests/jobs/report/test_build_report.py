"""What a build says at its end."""

from __future__ import annotations

from typing import Any

import pytest

from jobs.report.build_report import BuildReport


def report(repairs: dict[str, Any]) -> BuildReport:
    return BuildReport("s", 1, {}, repairs, {}, "serial", 1, {}, {}, 1.0, 1, ())


@pytest.mark.parametrize(
    ("repairs", "told"),
    [
        ({}, []),
        (
            {
                "duplicate faces": {"total": 3, "parts": {"a": 3}},
                "faces without area": {"total": 455_452, "parts": {"a": 2, "pipe": 455_448, "z": 2}},
            },
            [
                "left out or repaired: 455,452 faces without area (455,448 in pipe, 3 parts)",
                "left out or repaired: 3 duplicate faces (in a)",
            ],
        ),
    ],
)
def test_what_an_import_left_out_is_told_with_the_part_that_has_most_of_it(repairs, told):
    assert report(repairs).left_out() == told
