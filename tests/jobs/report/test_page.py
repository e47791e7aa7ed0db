"""The page about a store: one file that needs no other, with every picture, plot and number in it."""

from __future__ import annotations

import json
import re
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image

from jobs.checking.verify import verify
from jobs.parameters import BuildParameters
from jobs.pipeline import build
from jobs.report.page import write_page
from jobs.report.plots import SHARE_COLOURS, SHARES, box_map, histogram, lines, share_legend, share_map
from jobs.running.executors import SerialExecutor
from storage import open_store
from storage.base.errors import ParameterError
from tests.jobs.tiny_model import write_rooms


def play_report(strategy, images):
    """A report of a walk, as `vlod play --headless --report` writes it."""
    rows = [
        {
            "index": index,
            "image": f"frame_{index:04d}.png" if images else None,
            "position": [1.0 + index, 2.0, 1.5],
            "triangles": 100 + index,
            "drawables": 20,
            "frame_ms": 3.5,
            "bytes_fetched": 1000 * index,
        }
        for index in range(5)
    ]
    statistics = {"mean": 1.0, "median": 1.0, "p95": 1.0, "max": 2.0}
    totals = dict.fromkeys(("triangles", "frame_ms", "cache_bytes"), statistics)
    return {
        "strategy": strategy,
        "pixel_error": 1.0,
        "graphics": {"renderer": "<a & b>"},
        "frames": rows,
        "totals": {**totals, "bytes_fetched": 4000},
    }


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("demo")
    model = write_rooms(path / "rooms.obj", rooms=1)
    report = build([model], path / "rooms.store", BuildParameters(max_depth=1), SerialExecutor())
    (path / "build.json").write_text(report.to_text())
    checked = verify(str(path / "rooms.store"), samples=50, cells=2)
    (path / "verify.json").write_text(json.dumps(checked.to_json()))
    (path / "play.json").write_text(json.dumps(play_report("vlod", True)))
    (path / "play-none.json").write_text(json.dumps(play_report("none", False)))
    (path / "frames").mkdir()
    for index in range(5):
        picture = Image.new("RGB", (320, 180), (40 * index, 90, 120))
        picture.save(path / "frames" / f"frame_{index:04d}.png")
    return path


def test_the_page_needs_no_other_file(folder):
    page = write_page(folder)
    text = page.read_text()
    addresses = re.findall(r'(?:src|href)="([^"]*)"', text)
    assert len(addresses) >= 6
    assert all(address.startswith("data:image/") for address in addresses)
    assert "http" not in text
    assert "<script" not in text
    assert "&lt;a &amp; b&gt;" in text
    assert text.count("<svg") == 7


def test_the_film_holds_every_frame(folder):
    write_page(folder)
    with Image.open(folder / "film.webp") as film:
        assert film.n_frames == 5
        assert film.size == (640, 360)


def test_the_page_maps_how_much_is_undecided(folder):
    text = write_page(folder).read_text()
    store = open_store(str(folder / "rooms.store"))
    cells = store.cells[store.cells["computed"]]
    maps = [ElementTree.fromstring(found) for found in re.findall(r"<svg.*?</svg>", text)]
    at_path, worst = (found for found in maps if "from above" in found.attrib["aria-label"])
    low, high = cells["lo"][:, 2], cells["hi"][:, 2]
    middle = float(np.median([row["position"][2] for row in play_report("vlod", False)["frames"]]))
    assert len(at_path) == int(((low <= middle) & (high > middle)).sum())
    said = [rect[0].text.split(" undecided")[0] for rect in worst]
    share = 100 * (cells["triangles"] - cells["proven_triangles"].astype(np.int64)) / np.maximum(cells["triangles"], 1)
    columns = [(cells["lo"][:, :2] == place).all(axis=1) for place in np.unique(cells["lo"][:, :2], axis=0)]
    assert sorted(said) == sorted(f"{share[column].max():.0f} %" for column in columns)
    assert "proven hidden" in text
    assert all(colour in text for colour in SHARE_COLOURS)


def test_a_map_of_shares_has_the_legends_colours_the_greatest_on_top():
    lo = np.array([[0.0, 0], [1, 0], [0, 0]])
    svg = share_map(lo, lo + 1, np.array([1.0, 0.04, 0.5]), ["all", "little", "half"], "map")
    rects = list(ElementTree.fromstring(svg))
    assert [rect[0].text for rect in rects] == ["little", "half", "all"]
    fills = [SHARE_COLOURS[0], SHARE_COLOURS[SHARES.index(0.5)], SHARE_COLOURS[-1]]
    assert [rect.attrib["fill"] for rect in rects] == fills
    legend = share_legend()
    assert [legend.index(colour) for colour in SHARE_COLOURS] == sorted(legend.index(c) for c in SHARE_COLOURS)
    assert "35 to 50 %" in legend


def test_a_missing_report_is_named(folder, tmp_path):
    with pytest.raises(ParameterError, match=r"build\.json"):
        write_page(tmp_path)


@pytest.mark.parametrize(
    "svg",
    [
        lines({"a": [1.0, 10.0, 1000.0], "b": [0.0, 0.0, 0.0]}, "frame", "x & y", logarithmic=True),
        lines({"a": [0.0]}, "frame", "nothing"),
        lines({"a": []}, "frame", "nothing", logarithmic=True),
        histogram(np.array([1.0, 5.0, 5.0]), "x", "y"),
        histogram(np.zeros(0), "x", "y"),
        box_map(np.zeros((1, 2)), np.ones((1, 2)), np.array([3.0]), np.array([[0.5, 0.5], [0.6, 0.7]]), "map"),
        share_map(np.zeros((1, 2)), np.ones((1, 2)), np.array([0.3]), ["a & b"], "map"),
        share_map(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0), [], "no cells"),
    ],
)
def test_plots_are_sound_svg(svg):
    picture = ElementTree.fromstring(svg[: svg.index("</svg>") + 6])
    assert picture.tag == "svg"
    assert "nan" not in svg
    assert "inf" not in svg
