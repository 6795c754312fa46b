"""Where numba may keep compiled kernels: it refuses to work where it finds no folder that it can write, as in
a read-only installation without a home.
"""

from __future__ import annotations

import os
import sys

VARIABLE = "NUMBA_CACHE_DIR"


def settle() -> None:
    """Name a folder for temporary files where numba could write none of its own; to be called before the
    first kernel is imported.
    """
    given = os.environ.get(VARIABLE)
    if (given and _can_write(given)) or _can_write(_tree_folder()) or _can_write(_home_folder()):
        return
    folder, new = _make_temporary()
    os.environ[VARIABLE] = folder  # also for the processes that this one starts
    os.environ.setdefault("MPLCONFIGDIR", folder)  # Matplotlib keeps what it knows of fonts in the home too
    if "numba" in sys.modules:
        sys.modules["numba"].config.CACHE_DIR = folder
    if new:
        import logging

        logging.getLogger("o3dls").warning(
            "compiled code is kept in %s, as neither the installation nor the home can be written; "
            "%s names another place",
            folder,
            VARIABLE,
        )


def _tree_folder() -> str:
    """Return the folder for compiled code beside the modules of a package, numba's first choice: all are
    installed together, and one stands for the others.
    """
    return os.path.join(os.path.dirname(__file__), "geometry", "__pycache__")


def _home_folder() -> str:
    """Return the folder for caches in the home, its second choice."""
    caches = "~/Library/Caches" if sys.platform == "darwin" else "~/.cache"
    base = os.environ.get("LOCALAPPDATA" if os.name == "nt" else "XDG_CACHE_HOME")
    return os.path.join(base or os.path.expanduser(caches), "numba")


def _can_write(folder: str) -> bool:
    """Return whether a folder can be written, by trying: permissions tell nothing of a read-only file system,
    nor to root.
    """
    path = os.path.join(folder, f"o3dls-{os.getpid()}")
    try:
        os.makedirs(folder, exist_ok=True)
        os.close(os.open(path, os.O_CREAT | os.O_WRONLY))
        os.unlink(path)
    except OSError:
        return False
    return True


def _make_temporary() -> tuple[str, bool]:
    """Make a folder of this user alone, and return it and whether it is new. Numba runs what it finds there,
    so none is taken that somebody else may have made.
    """
    import stat
    import tempfile

    if os.name == "nt":  # on Windows, temporary folders belong to one user
        return os.path.join(tempfile.gettempdir(), "o3dls-numba"), False
    folder = os.path.join(tempfile.gettempdir(), f"o3dls-numba-{os.getuid()}")
    try:
        os.mkdir(folder, 0o700)
    except FileExistsError:
        found = os.lstat(folder)
        if stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o077:
            return folder, False
        return tempfile.mkdtemp(prefix="o3dls-numba-"), True
    return folder, True
