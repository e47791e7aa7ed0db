import errno
import io
import json
import re
import subprocess
import sys
from pathlib import Path

import click
import pytest
from click.testing import CliRunner, Result

from storage.base.errors import ModelError
from storage.cli import command
from storage.cli.info import info
from storage.shards.manifest import FORMAT
from tests.storage.tiny_store import box_part, make_store, room_parts


def _run(*args: str) -> Result:
    return CliRunner().invoke(command.vlod, list(args))


def _with(monkeypatch: pytest.MonkeyPatch, error: BaseException | int) -> Result:
    """The result of a subcommand that fails like this."""

    @click.command()
    @click.pass_context
    def failing(context: click.Context) -> None:
        if isinstance(error, int):
            context.exit(error)
        raise error

    monkeypatch.setattr(command, "failing", failing, raising=False)
    monkeypatch.setitem(command._COMMANDS, "failing", command._Lazy("storage.cli.command", "failing", "Fails.", "jobs"))
    return _run("failing")


def test_help_lists_all_commands_and_imports_nothing_heavy() -> None:
    code = (
        "import sys\nfrom storage.cli import command\n"
        "try:\n    command.vlod.main(['--help'])\nexcept SystemExit as end:\n    assert end.code == 0\n"
        "heavy = {'numpy', 'numba', 'rich', 'fsspec', 'zstandard', 'ray', 'trimesh', 'moderngl'}\n"
        "sys.stderr.write(repr(sorted(heavy & set(sys.modules))))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr == "[]"
    for name in command._COMMANDS:
        assert f"  {name} " in done.stdout
    assert "Example:" in done.stdout


@pytest.mark.parametrize(
    ("error", "code", "message"),
    [
        (ModelError("ship.glb is\nno model"), 2, "error: ship.glb is no model"),
        (KeyboardInterrupt(), 130, "interrupted"),
        (OSError(errno.ENOSPC, "No space left on device", "/full/x"), 2, "error: /full/x: No space left on device"),
        (PermissionError(errno.EACCES, "Permission denied", "/root/x"), 2, "error: /root/x: Permission denied"),
        (OSError(errno.EROFS, "Read-only file system"), 2, "error: Read-only file system"),
        (
            ModuleNotFoundError("No module named 'trimesh'", name="trimesh"),
            2,
            "error: vlod failing needs vlod[jobs] (trimesh is not installed): pip install 'vlod[jobs]'",
        ),
        (click.UsageError("which store?"), 2, "which store?"),
        (1, 1, ""),
        (0, 0, ""),
    ],
)
def test_errors_end_in_one_line(
    monkeypatch: pytest.MonkeyPatch, error: BaseException | int, code: int, message: str
) -> None:
    result = _with(monkeypatch, error)
    assert result.exit_code == code
    assert message in result.output
    assert "Traceback" not in result.output
    if message.startswith("error"):
        assert result.output == message + "\n"


@pytest.mark.parametrize("error", [RuntimeError("a fault"), OSError(errno.EIO, "broken disk")])
def test_faults_are_not_hidden(monkeypatch: pytest.MonkeyPatch, error: Exception) -> None:
    assert _with(monkeypatch, error).exception is error


def test_a_missing_module_of_our_own_is_a_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    error = ModuleNotFoundError("No module named 'jobs.nothing'", name="jobs.nothing")
    assert _with(monkeypatch, error).exception is error


def test_a_side_that_is_not_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(
        command._COMMANDS, "build", command._Lazy("uninstalled_side.commands", "build", "Builds.", "jobs")
    )
    result = _run("build", "x", "y")
    assert result.exit_code == 2
    assert "vlod build needs vlod[jobs]" in result.output


def test_unknown_commands_and_options() -> None:
    assert _run("fly").exit_code == 2
    assert "No such command" in _run("fly").output
    assert _run("info", "--wrong").exit_code == 2
    assert _run("--version").exit_code == 0


def test_info_is_plain_when_it_is_not_on_a_terminal(tmp_path: Path) -> None:
    make_store(tmp_path, room_parts())
    result = _run("info", str(tmp_path))
    assert result.exit_code == 0
    assert result.output.isascii()
    assert "\x1b" not in result.output
    for text in ("3,840 triangles in 12 parts", "64 of 64", "64 at depth 2", "tightness", "what is seen from cells"):
        assert text in result.output
    assert "gaps" not in result.output
    assert all(line == line.rstrip() for line in result.output.splitlines())


def test_info_as_json_says_everything(tmp_path: Path) -> None:
    store = make_store(tmp_path, room_parts())
    facts = json.loads(_run("info", "--json", str(tmp_path)).output)
    assert facts["counts"]["drawables"] == len(store.drawables) == sum(row["drawables"] for row in facts["levels"])
    assert facts["cells"]["computed"] == 64
    assert facts["cells"]["depths"] == {"2": 64}
    assert facts["cells"]["tightness"] == 1.0
    assert facts["cells"]["worst"] == []  # all that is reported is proven
    on_disk = sum(path.stat().st_size for path in tmp_path.rglob("*") if path.is_file())
    versions = (tmp_path / "versions" / "1.json").stat().st_size
    assert facts["bytes"]["total"] == on_disk - versions
    sizes = facts["bytes"]
    kinds = ("meshes", "source faces", "tables", "names", "what is seen from cells")
    assert sum(sizes[kind] for kind in kinds) + sizes["indices and checksums"] + sizes["manifest"] == sizes["total"]
    assert sizes["per_cell"] == sizes["what is seen from cells"] / 64


def test_info_counts_what_can_be_seen_through(tmp_path: Path) -> None:
    panes = [
        box_part("pane", (3, 0, 0), (3.1, 2, 2), segments=(8, 1), colour=(9, 9, 200, 80)),
        box_part("dim pane", (5, 0, 0), (5.1, 2, 2), colour=(9, 9, 200, 254)),
    ]
    store = make_store(tmp_path / "glass", [*room_parts(), *panes], depth=1)
    facts = json.loads(_run("info", "--json", str(tmp_path / "glass")).output)["see_through"]
    assert facts == {"drawables": 4, "triangles": 2 * 6 * (64 + 1 + 16 + 1)}
    assert facts["drawables"] == store.drawables["see_through"].sum()
    assert "4 drawables of 984 triangles" in _run("info", str(tmp_path / "glass")).output
    make_store(tmp_path / "none", room_parts(), depth=1)
    assert "0 drawables of 0 triangles" in _run("info", str(tmp_path / "none")).output


def test_info_names_cells_with_a_raised_pixel_error(tmp_path: Path) -> None:
    raised = {7: 3.0, 9: 1.5, **dict.fromkeys(range(20, 41), 2.0)}
    store = make_store(tmp_path, room_parts(), raised=raised, triangles_per_cell=1000)
    cells = json.loads(_run("info", "--json", str(tmp_path)).output)["cells"]
    assert [(row["cell"], row["pixel_error"]) for row in cells["raised"]] == sorted(
        raised.items(), key=lambda item: (-item[1], item[0])
    )
    row = cells["raised"][0]
    assert (row["lo"], row["hi"]) == (store.cells["lo"][7].tolist(), store.cells["hi"][7].tolist())
    assert row["reported_triangles"] == store.cells["triangles"][7]
    assert cells["above_target"] == (store.cells["triangles"] > 1000).sum() > 0
    text = _run("info", str(tmp_path)).output
    assert "pixel error raised          23" in text
    assert f"above --triangles-per-cell  {cells['above_target']}" in text
    listed = text.partition("Cells with a raised pixel error, to keep a bound, 20 of 23\n")[2].splitlines()
    assert listed[1].split()[:2] == ["7", "3"]
    assert listed[20].split()[:2] == ["38", "2"]
    assert listed[21] == ""


def test_info_tells_of_no_raised_pixel_error_where_there_is_none(tmp_path: Path) -> None:
    make_store(tmp_path, room_parts(), depth=1, pixel_error=0.3)
    assert json.loads(_run("info", "--json", str(tmp_path)).output)["cells"]["raised"] == []
    text = _run("info", str(tmp_path)).output
    assert "pixel error raised          0" in text
    assert "to keep a bound" not in text


def test_info_without_cells(tmp_path: Path) -> None:
    make_store(tmp_path, room_parts()[:1], keys=[])
    result = _run("info", str(tmp_path))
    assert result.exit_code == 0
    assert "computed" in result.output
    assert json.loads(_run("info", "--json", str(tmp_path)).output)["cells"] == {"cells": 0, "computed": 0}


def test_info_of_what_is_no_store(tmp_path: Path) -> None:
    result = _run("info", str(tmp_path))
    assert result.exit_code == 2
    assert result.output.startswith(f"error: {tmp_path}: no manifest.json: not a vLOD store")
    assert result.output.count("\n") == 1


def test_info_on_a_terminal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store = make_store(tmp_path, room_parts(), raised={7: 3.0})
    shown = io.StringIO()
    monkeypatch.setattr(shown, "isatty", lambda: True)
    monkeypatch.setattr("sys.stdout", shown)
    monkeypatch.setenv("COLUMNS", "120")
    monkeypatch.setenv("TERM", "xterm-256color")
    monkeypatch.chdir(tmp_path)  # a short name fits into a title
    assert info.callback is not None
    info.callback(".", False)
    assert "\x1b[" in shown.getvalue()  # in colours
    lines = [line.rstrip() for line in re.sub(r"\x1b\[[0-9;]*m", "", shown.getvalue()).splitlines()]
    titles = [
        f".  (version 1, format {FORMAT})",
        "Drawables",
        "Cells",
        "Certificate, all cells together",
        "Cells by tightness",
        "Cells with a raised pixel error, to keep a bound",
        "Bytes",
    ]
    assert [line for line in lines if line in titles] == titles
    rows = [line.split() for line in lines]
    assert ["leaves,", "0", "12", "3,840", "1", "mm", "2.24", "m", "1", "mm", "2.24", "m"] in rows
    assert ["computed", "64", "of", "64"] in rows
    assert [row[1:3] for row in rows if row[:1] == ["7"]] == [["3", f"{store.cells['triangles'][7]:,}"]]
