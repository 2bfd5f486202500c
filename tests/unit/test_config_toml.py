"""Config files from outside: hostile, broken, or merely mistaken."""

from __future__ import annotations

from pathlib import Path

import pytest

from ndf_core.config.toml import MAX_BYTES, read_config_file
from ndf_core.errors import ConfigError


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"[fit]\nsteps = 5\nfaces = = 3\n", r"fit\.toml: not valid TOML: .*line 3"),
        (b"[fit]\nsteps = 5\nsteps = 6\n", r"not valid TOML: .*line 3"),
        (b"[fit]\nname = '\xff'\n", r"fit\.toml: not UTF-8 text \(at line 2\)"),
        (b"#" * (MAX_BYTES + 1), "longer than 1048576 bytes"),
        (b"x = " + b"[" * 100_000, "not valid TOML"),
    ],
)
def test_what_is_no_config_is_one_error_with_its_line(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "fit.toml"
    path.write_bytes(content)
    with pytest.raises(ConfigError, match=message):
        read_config_file(path)


def test_a_missing_file_or_a_folder_is_said_to_be_one(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot be read as a config file: No such file"):
        read_config_file(tmp_path / "none.toml")
    with pytest.raises(ConfigError, match="cannot be read as a config file: Is a directory"):
        read_config_file(tmp_path)


def test_wrong_top_level_keys_wait_for_the_error_that_lists_everything(tmp_path: Path) -> None:
    path = tmp_path / "fit.toml"
    path.write_text("repr = 3\nfit = 4\nrepresentations = 5\n")
    file = read_config_file(path)
    assert (file.repr, file.fit, file.representation) == (None, {}, {})
    assert file.errors == (
        f"{path}: representations: there is no such table; did you mean representation?",
        f"{path}: repr: must be the name of a representation (got 3)",
        f"{path}: fit: must be a table of options (got 4)",
    )
