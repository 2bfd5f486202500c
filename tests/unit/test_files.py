"""`atomic_write` leaves the whole new file or the old one, and nothing else."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from ndf_core import files
from ndf_core.errors import OutputError
from ndf_core.files import atomic_write


def refuse(*args: object, **kwargs: object) -> None:
    raise PermissionError("no")


@pytest.fixture(params=["unnamed", "named", "unlinkable"])
def every_way(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """With unnamed files where the platform has them, without, and where they cannot be linked."""
    if request.param == "named":
        monkeypatch.setattr(files, "_open_unnamed", lambda folder: None)
    if request.param == "unlinkable":
        monkeypatch.setattr(os, "link", refuse)


@pytest.mark.usefixtures("every_way")
class TestEveryWay:
    def test_the_file_appears_when_the_block_ends(self, tmp_path: Path) -> None:
        path = tmp_path / "a.bin"
        with atomic_write(path) as file:
            file.write(b"half")
            assert not path.exists()
            file.write(b" whole")
        assert path.read_bytes() == b"half whole"
        assert os.listdir(tmp_path) == ["a.bin"]

    def test_an_old_file_is_replaced_at_once(self, tmp_path: Path) -> None:
        path = tmp_path / "a.bin"
        path.write_bytes(b"old")
        with atomic_write(path) as file:
            file.write(b"new")
            file.flush()
            assert path.read_bytes() == b"old"
        assert path.read_bytes() == b"new"
        assert os.listdir(tmp_path) == ["a.bin"]

    def test_an_exception_leaves_the_old_file_alone(self, tmp_path: Path) -> None:
        path = tmp_path / "a.bin"
        path.write_bytes(b"old")
        with pytest.raises(KeyboardInterrupt), atomic_write(path) as file:
            file.write(b"new")
            raise KeyboardInterrupt
        assert path.read_bytes() == b"old"
        assert os.listdir(tmp_path) == ["a.bin"]

    def test_permissions_are_those_of_any_new_file(self, tmp_path: Path) -> None:
        (tmp_path / "plain").write_bytes(b"")
        with atomic_write(tmp_path / "a.bin"):
            pass
        modes = [stat.S_IMODE((tmp_path / name).stat().st_mode) for name in ("plain", "a.bin")]
        assert modes[0] == modes[1]

    def test_a_missing_folder_is_an_output_error(self, tmp_path: Path) -> None:
        with (
            pytest.raises(OutputError, match=r"there is no folder .*create it first"),
            atomic_write(tmp_path / "no" / "a"),
        ):
            pass

    def test_a_folder_in_its_place_is_an_output_error(self, tmp_path: Path) -> None:
        with pytest.raises(OutputError, match="is a folder; give a file name"), atomic_write(tmp_path):
            pass

    def test_a_name_that_cannot_be_is_an_output_error(self, tmp_path: Path) -> None:
        with pytest.raises(OutputError, match="cannot write"), atomic_write(tmp_path / ("x" * 300)) as file:
            file.write(b"new")
        assert os.listdir(tmp_path) == []


def test_a_killed_process_leaves_no_file_of_that_name(tmp_path: Path) -> None:
    """And none at all where files without a name exist (Linux)."""
    script = (
        "import sys, time; from pathlib import Path; from ndf_core.files import atomic_write\n"
        "with atomic_write(Path(sys.argv[1])) as file:\n"
        "    file.write(b'x' * 100000); file.flush(); print('written', flush=True); time.sleep(600)\n"
    )
    command = [sys.executable, "-c", script, str(tmp_path / "a.bin")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as writer:
        assert writer.stdout is not None
        assert writer.stdout.readline() == "written\n"
        writer.kill()
    assert writer.returncode != 0
    left = os.listdir(tmp_path)
    assert "a.bin" not in left
    assert not (left and hasattr(os, "O_TMPFILE"))
