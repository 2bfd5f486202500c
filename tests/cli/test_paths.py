"""Outputs that cannot be written are refused before the work."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from ndf_core.cli.paths import check_output
from ndf_core.errors import OutputError


def test_a_new_file_and_an_old_one_are_both_fine(tmp_path: Path) -> None:
    check_output(tmp_path / "new.ndf", (".ndf",))
    (tmp_path / "old.NDF").touch()
    check_output(tmp_path / "old.NDF", (".ndf",))


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("x.txt", "the output must end in .ndf .ply"),
        ("x", "the output must end in"),
        ("folder.ndf", "there is a folder of this name"),
        ("none/x.ndf", "there is no folder"),
        ("file/x.ndf", "there is no folder"),
        ("pipe.ndf", "no regular file"),
        ("input.ndf", "would replace the input"),
        ("link.ndf", "would replace the input"),
        ("x" * 300 + ".ndf", "cannot be written: File name too long"),
    ],
)
def test_what_cannot_be_written_is_refused(tmp_path: Path, name: str, message: str) -> None:
    (tmp_path / "folder.ndf").mkdir()
    (tmp_path / "file").touch()
    (tmp_path / "input.ndf").touch()
    (tmp_path / "link.ndf").symlink_to(tmp_path / "input.ndf")
    os.mkfifo(tmp_path / "pipe.ndf")
    with pytest.raises(OutputError, match=message):
        check_output(tmp_path / name, (".ndf", ".ply"), tmp_path / "input.ndf")


def test_a_folder_without_permission_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Root may write everywhere, so the system's answer is put in its mouth."""
    monkeypatch.setattr(os, "access", lambda path, mode: path != tmp_path)
    with pytest.raises(OutputError, match="is not writable"):
        check_output(tmp_path / "x.ndf", (".ndf",))
