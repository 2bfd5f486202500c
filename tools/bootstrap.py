"""Make .venv with every package of this repository, editable; `make` calls this before everything.

Needs Python 3.11+ with venv, pip and headers, and a C compiler; reaches a package index and, for torch only where
that has no CPU build, PyTorch's own. Does nothing when .venv is up to date. Standard library only, and readable by
an old Python, which has to be able to say that it is too old.
"""

import hashlib
import os
import platform
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parent.parent
VENV = REPOSITORY / ".venv"
STAMP = VENV / "ndf-stamp"
BASE_STAMP = VENV / "ndf-base-stamp"
"""Of the part that survives when a project or a C source changes: the interpreter and torch."""
CONSTRAINTS = REPOSITORY / "constraints.txt"
CPU_INDEX = "https://download.pytorch.org/whl/cpu"
OLDEST = (3, 11)


def main() -> int:
    if sys.version_info < OLDEST:
        return with_newer_python()
    stamp = fingerprint()
    if STAMP.is_file() and STAMP.read_text() == stamp and venv_python().exists():
        return 0
    missing = missing_from_system()
    if missing:
        print("\n".join(["This machine lacks:", *missing]), file=sys.stderr)
        return 1
    base = base_fingerprint()
    if not (BASE_STAMP.is_file() and BASE_STAMP.read_text() == base):
        # --clear: a .venv that failed half-way, or was made by another Python, is worth nothing.
        run(sys.executable, "-m", "venv", "--clear", str(VENV))
        install_torch()
        BASE_STAMP.write_text(base)
    packages = [f"{REPOSITORY}[fit,processing,dev,docs]", *(f"{path.parent}[test]" for path in plugin_projects())]
    say("installing ndf and what it needs (a few minutes the first time)")
    # "compat" puts folders on the path; import hooks, the default, cost every start of Python 30 ms and more.
    editable = [
        "--config-settings",
        "editable_mode=compat",
        *(w for package in packages for w in ("--editable", package)),
    ]
    run(*pip("install"), *editable)
    # Python itself writes no bytecode where PYTHONDONTWRITEBYTECODE is set, as in many containers.
    run(str(venv_python()), "-m", "compileall", "-q", str(REPOSITORY / "ndf_core"), str(REPOSITORY / "plugins"))
    STAMP.write_text(stamp)
    return 0


def with_newer_python() -> int:
    """Go on with the newest Python on the path, or say how to get one."""
    for minor in range(20, OLDEST[1] - 1, -1):
        found = shutil.which(f"python3.{minor}")
        if found and subprocess.call([found, "-c", ""], stderr=subprocess.DEVNULL) == 0:
            return subprocess.call([found, *sys.argv])
    have = platform.python_version()
    print(
        f"ndf needs Python 3.11 or newer; this is {have}. Install one:\n  {system_install('python')}", file=sys.stderr
    )
    return 1


def plugin_projects():
    return sorted(REPOSITORY.glob("plugins/*/pyproject.toml"))


def fingerprint() -> str:
    """Of all that decides what .venv must hold: projects, constraints, C sources, this script, the Python."""
    files = [REPOSITORY / name for name in ("pyproject.toml", "setup.py")]
    files += [*plugin_projects(), *sorted(REPOSITORY.glob("ndf_core/kernels/src/*"))]
    return digest(base_fingerprint(), files)


def base_fingerprint() -> str:
    files = [REPOSITORY / "constraints.txt", Path(__file__)]
    return digest(f"{sys.version} {sys.base_prefix} {REPOSITORY}", files)


def digest(start: str, files) -> str:
    found = hashlib.sha256(start.encode())
    for path in files:
        found.update(path.name.encode() + b"\0" + path.read_bytes())
    return found.hexdigest()


def missing_from_system():
    """One line for each thing that has to come from the system, with the command that installs it."""
    missing = []
    probe = subprocess.run([sys.executable, "-c", "import venv, ensurepip"], capture_output=True)
    if probe.returncode:
        missing.append(f"  Python's venv module:  {system_install('venv')}")
    compiler = (os.environ.get("CC") or sysconfig.get_config_var("CC") or "cc").split()[0]
    if not any(map(shutil.which, (compiler, "cc", "gcc", "clang"))) and os.name == "posix":
        missing.append(f"  a C compiler:  {system_install('compiler')}")
    if not Path(sysconfig.get_path("include"), "Python.h").is_file():
        missing.append(f"  Python's headers (Python.h):  {system_install('headers')}")
    return missing


def system_install(what: str) -> str:
    """The command of this system's package manager."""
    version = f"{sys.version_info[0]}.{sys.version_info[1]}"
    newer = "3.11" if sys.version_info < OLDEST else version
    names = {
        "apt": {"python": f"python{newer} python{newer}-venv python{newer}-dev", "venv": f"python{version}-venv",
                "compiler": "gcc libc6-dev", "headers": f"python{version}-dev"},
        "dnf": {"python": f"python{newer} python{newer}-devel", "venv": f"python{version}", "compiler": "gcc",
                "headers": f"python{version}-devel"},
    }  # fmt: skip
    if sys.platform == "darwin":
        return "xcode-select --install" if what in ("compiler", "headers") else f"brew install python@{newer}"
    for manager in names:
        if shutil.which(manager):
            return f"sudo {manager} install {names[manager][what]}"
    return f"install {names['apt'][what]} (Debian's names) with this system's package manager"


def install_torch() -> None:
    """Take a CPU build where one can be had: a plain index's for Linux is a CUDA build of several gigabytes."""
    wanted = next(line.strip() for line in CONSTRAINTS.read_text().splitlines() if line.startswith("torch=="))
    if not sys.platform.startswith("linux") or os.environ.get("NDF_TORCH") == "index":
        return  # elsewhere the plain build is the CPU build; or the user wants what the index has
    listed = subprocess.run([*pip("index"), "versions", "torch"], capture_output=True, text=True).stdout
    if f"{wanted.partition('==')[2]}+cpu" in listed:
        say(f"installing {wanted} (CPU build from the configured index)")
        run(*pip("install"), wanted)
        return
    say(f"installing {wanted} (CPU build from {CPU_INDEX}; NDF_TORCH=index takes the index's own build)")
    if subprocess.call([*pip("install"), "--index-url", CPU_INDEX, wanted]):
        say(f"cannot reach {CPU_INDEX}: taking the configured index's torch, which on Linux brings CUDA (gigabytes).")
        say("To avoid that, put a CPU wheel of torch where pip finds it (PIP_FIND_LINKS=folder) and run make again.")


def pip(command: str):
    words = [str(venv_python()), "-m", "pip", "--disable-pip-version-check", command]
    return words if command == "index" else [*words, "-qq", "--no-input", "--constraint", str(CONSTRAINTS)]


def venv_python() -> Path:
    return VENV / ("Scripts/python.exe" if os.name == "nt" else "bin/python")


def run(*command: str) -> None:
    code = subprocess.call(command)
    if code:
        print(f"failed: {' '.join(command)}", file=sys.stderr)
        raise SystemExit(code)


def say(text: str) -> None:
    print(f"[setup] {text}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
