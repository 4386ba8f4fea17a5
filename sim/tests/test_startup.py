"""Start of the command-line programs: missing packages, and the entry point of the installed package."""

import os
import subprocess
import sys
import tomllib
from importlib import import_module

import pytest

from conftest import REPOSITORY, SCENES


def run(*arguments, path=(), flags=()):
    """Runs a module with the generator's sources and the folders `path` on the search path."""
    search = os.pathsep.join(map(str, (*path, REPOSITORY / "sim")))
    command = [sys.executable, *flags, "-m", *map(str, arguments)]
    return subprocess.run(command, env={**os.environ, "PYTHONPATH": search}, capture_output=True, text=True)


@pytest.mark.parametrize("module", ["whisker_sim", "whisker_sim.rig", "whisker_sim.physics"])
def test_robust_without_packages_one_line_states_the_remedy(module):
    """Without the folder of installed packages (`-S`): exit code 1, no traceback."""
    done = run(module, "--help", flags=["-S"])
    assert done.returncode == 1
    assert done.stdout == ""
    assert done.stderr.startswith("error: expected the package '")
    assert done.stderr.endswith("', found none: pip install ./sim, in the repository's root\n")
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("package", "arguments", "requirement"),
    [
        ("mujoco", ["whisker_sim", "simulate", SCENES / "golden_pin.json", "--out", "out"], "./sim"),
        ("distributed", ["whisker_sim", "cluster", "simulate", "--scheduler", "tcp://127.0.0.1:1", "x"], "'./sim[cluster]'"),
        ("scipy", ["whisker_sim.physics", "--help"], "'./sim[dev]'"),
    ],
)
def test_robust_a_package_that_a_command_lacks(tmp_path, package, arguments, requirement):
    """Packages that a command imports when it needs them."""
    (tmp_path / f"{package}.py").write_text(f"raise ModuleNotFoundError(\"No module named '{package}'\", name='{package}')\n")
    done = run(*arguments, path=[tmp_path])
    assert done.returncode == 1
    assert (
        done.stderr == f"error: expected the package '{package}', found none: pip install {requirement}, in the repository's root\n"
    )


def test_verif_the_installed_command_is_the_module():
    """`whisker-sim` calls the function that `python -m whisker_sim` calls."""
    project = tomllib.loads((REPOSITORY / "sim/pyproject.toml").read_text())
    module, _, function = project["project"]["scripts"]["whisker-sim"].partition(":")
    assert module == "whisker_sim.__main__"
    assert callable(getattr(import_module(module), function))


def test_verif_packages_have_the_versions_of_the_lock_file():
    """Versions that `pip install ./sim` installs are those of the lock file, which tests and published results use."""
    project = tomllib.loads((REPOSITORY / "sim/pyproject.toml").read_text())["project"]
    lock = (REPOSITORY / "sim/requirements-dev.lock").read_text()
    extras = [one for requirements in project["optional-dependencies"].values() for one in requirements]
    for requirement in (*project["dependencies"], *extras):
        assert f"\n{requirement.partition(' ;')[0]} " in lock
