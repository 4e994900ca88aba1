"""Where compiled kernels are kept, and the one decorator that compiles them.

Numba's own cache looks at the file of the compiled function only: after an edit of a function
that it calls, possibly in another file, the old machine code still runs. Here the cache folder
itself is keyed by the sources of the whole package, the versions of everything that compiles and
the processor, so any edit starts a fresh folder.
"""

import atexit
import hashlib
import importlib.util
import os
import platform
import shutil
import sys
import tempfile
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache, partial
from importlib.metadata import version
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar, overload

Function = TypeVar("Function", bound=Callable[..., Any])

CACHE_VARIABLE = "SHEAR_SIM_CACHE"
KEPT_FOLDERS = 8  # of one install; a developer's edit makes a new one each time
STALE_SECONDS = 15.0  # without a sign of the process that compiles
KEPT_SECONDS = 86_400.0  # a folder used within a day is never removed

_PACKAGE = Path(__file__).parent
_variant = ""  # key of the module variant that is being loaded, see variant()


def digest(text: str) -> str:
    """Return the first 16 hex digits of the SHA-256 of ``text``."""
    return hashlib.sha256(text.encode()).hexdigest()[:16]


@cache
def source_digest() -> str:
    """Return a digest of every Python source of the package: names and contents."""
    total = hashlib.sha256()
    for path in sorted(_PACKAGE.rglob("*.py")):
        total.update(f"{path.relative_to(_PACKAGE).as_posix()}\0".encode())
        total.update(hashlib.sha256(path.read_bytes()).digest())
    return total.hexdigest()[:16]


@cache
def processor() -> str:
    """Return name and features of the processor as the compiler sees them."""
    import llvmlite.binding as llvm  # not numba, which takes four times as long

    name = os.environ.get("NUMBA_CPU_NAME") or llvm.get_host_cpu_name()
    features = os.environ.get("NUMBA_CPU_FEATURES") or llvm.get_host_cpu_features().flatten()
    return f"{name} {features}"


@cache
def build_key() -> str:
    """Return a digest of all that decides bits: sources, versions and processor."""
    versions = [platform.python_version(), *map(version, ("numpy", "numba", "llvmlite"))]
    return digest("\0".join([source_digest(), *versions, processor()]))


@cache
def cache_folder(extra: str = "") -> Path:
    """Return the folder of compiled code of these sources, versions and processor; create it.

    Parameters
    ----------
    extra : str
        Digest of a source outside the package that is compiled into the kernels (a user's
        contact law): kernels built on it have a folder of their own.

    Notes
    -----
    The root is ``$SHEAR_SIM_CACHE``, else ``$XDG_CACHE_HOME/shear-sim``, else
    ``~/.cache/shear-sim``. A root that cannot be written is replaced, with a warning, by a
    temporary folder that this process removes when it ends.
    """
    name = f"{digest(str(_PACKAGE))[:8]}-{build_key()}"
    try:
        folder = _root() / name
        _make(folder / extra)
        os.utime(folder)  # the time of last use decides what is pruned
        _prune(folder)
    except (OSError, RuntimeError) as error:  # RuntimeError: no home directory is known
        folder = _temporary_root(error) / name
        _make(folder / extra)
    return folder / extra


@contextmanager
def compiling(what: str) -> Iterator[None]:
    """Let one process compile ``what``, into this context; others wait here, and then load it.

    The process that compiles renews a file every second. One that nobody has renewed for a while
    belongs to a dead process, and the next one takes over: nothing is locked. Once ``what`` has
    been compiled nobody waits any more.
    """
    folder = cache_folder()
    done, lease = folder / f"{what}.compiled", folder / f"{what}.compiling"
    if not _take(lease, done):
        yield
        return
    ended = threading.Event()
    renewing = threading.Thread(target=_renew, args=(lease, ended), daemon=True)
    renewing.start()
    try:
        yield
        done.touch()
    finally:
        ended.set()
        renewing.join()
        lease.unlink(missing_ok=True)


def _take(lease: Path, done: Path) -> bool:
    """Wait until ``done`` is there, or ``lease`` is ours; return whether it is."""
    seen, since = 0, time.monotonic()
    while not done.exists():
        try:
            lease.touch(exist_ok=False)
        except FileExistsError:
            with suppress(FileNotFoundError):
                # Whether it changes, not how old it is: clocks of two machines may differ.
                if (now := lease.stat().st_mtime_ns) != seen:
                    seen, since = now, time.monotonic()
                elif time.monotonic() > since + STALE_SECONDS:
                    lease.unlink(missing_ok=True)
            time.sleep(0.2)
        else:
            return True
    return False


def _renew(lease: Path, ended: threading.Event) -> None:
    while not ended.wait(1.0):
        with suppress(OSError):  # taken over by somebody who thought that we were dead
            os.utime(lease)


def _root() -> Path:
    """Return the folder that holds all cache folders."""
    if chosen := os.environ.get(CACHE_VARIABLE):
        return Path(chosen).absolute()
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "shear-sim"


def _make(folder: Path) -> None:
    """Create ``folder`` and prove that it can be written."""
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryFile(dir=folder):
        pass


def _temporary_root(error: Exception) -> Path:
    """Return a temporary root for this process and its workers, and say why."""
    root = Path(tempfile.mkdtemp(prefix="shear-sim-"))
    owner = os.getpid()

    def remove() -> None:
        if os.getpid() == owner:  # a forked worker ends before its supervisor
            shutil.rmtree(root, ignore_errors=True)

    atexit.register(remove)
    os.environ[CACHE_VARIABLE] = str(root)  # workers share it instead of compiling again
    warnings.warn(
        f"compiled code cannot be kept ({error}): it goes to a temporary folder and is compiled "
        f"again next time; set {CACHE_VARIABLE} to a folder that can be written",
        RuntimeWarning,
        stacklevel=3,
    )
    return root


def _prune(current: Path) -> None:
    """Remove the least recently used folders of this install, beyond the newest few."""
    install = current.name.split("-")[0]
    used = []
    for folder in current.parent.glob(f"{install}-*"):
        try:
            used.append((folder.stat().st_mtime, folder))
        except FileNotFoundError:  # another process prunes at the same time
            continue
    for last_use, folder in sorted(used, reverse=True)[KEPT_FOLDERS:]:
        if folder != current and last_use < time.time() - KEPT_SECONDS:
            shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def _numba_cache(folder: Path) -> Iterator[None]:
    """Let Numba keep what is decorated inside in ``folder``; other packages are not touched."""
    import numba

    config: Any = numba.config  # its attributes are made at run time
    before, config.CACHE_DIR = config.CACHE_DIR, str(folder)
    try:
        yield
    finally:
        config.CACHE_DIR = before


@overload
def jit(function: Function) -> Function: ...
@overload
def jit(*, inner: bool = ..., **options: Any) -> Callable[[Function], Function]: ...
def jit(function: Function | None = None, *, inner: bool = False, **options: Any) -> Any:
    """Compile a kernel with Numba and keep the machine code in :func:`cache_folder`.

    Use it bare (``@jit``) or with options of ``numba.njit`` (``@jit(nogil=True)``),
    but for ``inline="always"``: a call then counts who uses its arrays, ten times the work itself.
    Division by zero follows IEEE rules (``error_model="numpy"``), which lets loops vectorise;
    ``fastmath`` stays off, so that sums keep their order and results their bits.
    ``inner`` is for what only kernels call, and which creates no array: it has no way in from
    Python, and no count of who uses an array, and compiles in less time.
    """
    if function is None:
        return partial(_jit, inner=inner, **options)
    return _jit(function, inner=inner, **options)


def _jit(function: Function, *, inner: bool, **options: Any) -> Any:
    import numba

    if inner:
        options |= {"_nrt": False, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}

    with _numba_cache(cache_folder(_variant)):
        return numba.njit(**{"cache": True, "error_model": "numpy", **options})(function)


def variant(module: str, key: str) -> ModuleType:
    """Load a private copy of a kernel module, whose machine code is kept apart under ``key``.

    The caller puts its own function over a global of the copy before the first call: Numba reads
    globals when it compiles. This is how a user's contact law is compiled into the kernels.

    Parameters
    ----------
    module : str
        Full name of the kernel module.
    key : str
        Digest of everything that the copy will be given, see :func:`digest`.
    """
    global _variant  # read by jit, while the copy's decorators run below
    original = importlib.util.find_spec(module)
    location = original.origin if original else None
    spec = importlib.util.spec_from_file_location(f"{module}@{key}", location)
    if spec is None or spec.loader is None:
        msg = f"no Python source of a module {module}"
        raise ModuleNotFoundError(msg)
    copy = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = copy  # Numba looks the module of a kernel up by name
    before, _variant = _variant, key
    try:
        spec.loader.exec_module(copy)
    except BaseException:
        del sys.modules[spec.name]
        raise
    finally:
        _variant = before
    return copy
