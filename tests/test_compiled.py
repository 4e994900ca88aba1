import os
import shutil
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from tools import start, write_study

import shear_sim
from shear_sim import compiled

PACKAGE = Path(shear_sim.__file__).parent
CALLER = """
from shear_sim.compiled import jit
from shear_sim.probe_callee import slope
@jit
def force(x):
    return slope(x) * x
@jit
def twice(x):
    return 2 * force(x)
"""
CALLEE = """
from shear_sim.compiled import jit
@jit
def slope(x):
    return {slope} + 0 * x
"""


def run(root: Path, code: str, cache: Path | str) -> subprocess.CompletedProcess[str]:
    env = {**os.environ, "PYTHONPATH": str(root), "SHEAR_SIM_CACHE": str(cache)}
    return subprocess.run(
        [sys.executable, "-c", code], env=env, capture_output=True, text=True, check=True
    )


@pytest.fixture
def package_copy(tmp_path):
    """A copy of the package with a kernel that calls a kernel of another file."""
    root = tmp_path / "src"
    shutil.copytree(PACKAGE, root / "shear_sim", ignore=shutil.ignore_patterns("__pycache__"))
    (root / "shear_sim/probe_caller.py").write_text(CALLER)
    (root / "shear_sim/probe_callee.py").write_text(CALLEE.format(slope="3.0"))
    return root


def test_an_edited_callee_is_compiled_again(package_copy, tmp_path):
    """Numba alone would answer 12.0 from the caller's cache after the edit."""
    code = (
        "from shear_sim import probe_caller, compiled\n"
        "print(probe_caller.force(4.0), compiled.cache_folder())\n"
        "print(sum(probe_caller.force.stats.cache_hits.values()))"
    )
    cache = tmp_path / "cache"
    first = run(package_copy, code, cache).stdout.split()
    again = run(package_copy, code, cache).stdout.split()
    assert (first[0], first[2]) == ("12.0", "0")
    assert again == [first[0], first[1], "1"]  # the same folder, read from the cache
    (package_copy / "shear_sim/probe_callee.py").write_text(CALLEE.format(slope="5.0"))
    edited = run(package_copy, code, cache).stdout.split()
    assert (edited[0], edited[2]) == ("20.0", "0")
    assert edited[1] != first[1]


def test_a_variant_compiles_another_function_into_the_same_kernels(package_copy, tmp_path):
    code = (
        "import sys\n"
        "from shear_sim import compiled, probe_caller\n"
        "kernels = compiled.variant('shear_sim.probe_caller', compiled.digest('law'))\n"
        "kernels.slope = compiled.jit(cache=False)(eval('lambda x: 7.0'))\n"
        "print(kernels.twice(2.0), probe_caller.twice(2.0))\n"
        "print(sum(kernels.twice.stats.cache_hits.values()))\n"
    )
    cache = tmp_path / "cache"
    assert run(package_copy, code, cache).stdout.split() == ["28.0", "12.0", "0"]
    assert run(package_copy, code, cache).stdout.split() == ["28.0", "12.0", "1"]


def test_an_unwritable_cache_is_replaced_and_said(package_copy, tmp_path):
    (tmp_path / "file").write_text("")
    code = (
        "import os, sys\n"
        "from shear_sim import compiled, probe_caller\n"
        "print(probe_caller.force(4.0), compiled.cache_folder().parent)"
    )
    result = run(package_copy, code, tmp_path / "file/cache")
    value, root = result.stdout.split()
    assert value == "12.0"
    assert "compiled code cannot be kept" in result.stderr
    assert "SHEAR_SIM_CACHE" in result.stderr
    assert not Path(root).exists()  # removed at the end of the process


def test_jit_leaves_the_numba_cache_of_other_packages_alone(monkeypatch, tmp_path):
    import numba

    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))

    @compiled.jit
    def add(x):
        return x + 1.0

    assert str(tmp_path) == numba.config.CACHE_DIR
    assert add(1.0) == 2.0
    assert list(tmp_path.iterdir()) == []


def test_old_folders_of_this_install_only_are_pruned(tmp_path):
    now = time.time()

    def folder(name: str, days: float) -> Path:
        path = tmp_path / name
        path.mkdir()
        os.utime(path, (now - 86400 * days,) * 2)
        return path

    kept = [folder(f"aaaa-{i}", 2 + i) for i in range(compiled.KEPT_FOLDERS - 1)]
    old = [folder(f"aaaa-old{i}", 20 + i) for i in range(3)]
    other = folder("bbbb-1", 50)
    current = folder("aaaa-current", 0)
    compiled._prune(current)
    assert all(path.exists() for path in [*kept, other, current])
    assert not any(path.exists() for path in old)


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """An empty cache folder."""
    monkeypatch.setattr(compiled, "cache_folder", lambda: tmp_path)
    return tmp_path


class TestCompiling:
    """One process compiles, the others wait for it as long as it lives."""

    def test_the_second_waits_for_the_first_and_then_nobody_waits(self, cache):
        order = []

        def second():
            with compiled.compiling("kernels"):
                order.append("second")

        with compiled.compiling("kernels"):
            other = threading.Thread(target=second)
            other.start()
            time.sleep(1.5)  # longer than between two renewals
            order.append("first")
        other.join()
        assert order == ["first", "second"]
        assert [path.suffix for path in cache.glob("kernels.*")] == [".compiled"]

    def test_a_dead_process_holds_nothing(self, cache, monkeypatch):
        monkeypatch.setattr(compiled, "STALE_SECONDS", 0.5)
        lease = cache / "kernels.compiling"
        lease.touch()
        began = time.monotonic()
        with compiled.compiling("kernels"):
            assert time.monotonic() > began + 0.5
        assert not lease.exists()

    def test_a_failed_compilation_is_tried_by_the_next(self, cache):
        with pytest.raises(ZeroDivisionError), compiled.compiling("kernels"):
            raise ZeroDivisionError
        assert list(cache.glob("kernels.*")) == []


def test_two_sweeps_at_once_compile_once(tmp_path, environment):
    environment["SHEAR_SIM_CACHE"] = str(tmp_path / "cache")
    study = write_study(tmp_path, compiled=True)
    given = ("sweep", study, "--jobs", 1, "--results")
    both = [start(environment, *given, tmp_path / name) for name in "ab"]
    shown = [process.communicate(timeout=120)[0] for process in both]
    assert [process.returncode for process in both] == [0, 0], shown
    assert "".join(shown).count("compiling the kernels") == 1
