"""The file that a run folder keeps of a posterior in space: what it follows from, written and read back."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING
from zipfile import BadZipFile
from zlib import error as Undeflated

import numpy as np

from ..errors import InputError
from ..io.atomic import write_file

if TYPE_CHECKING:
    from ..motion.recorded import Motion
    from ..motion.wall.kept import KeptPosterior

# what numpy and zipfile raise where bytes are others: memory too, since a header may promise any size
FAULTS = (ValueError, EOFError, BadZipFile, Undeflated, RuntimeError, AttributeError, MemoryError)
KEPT = "posterior_rows.npz"  # what is observed of the motion, and how it varies before that (docs/files.md)


def write_posterior(path: Path, motion: Motion) -> None:
    """Write what the posterior of a motion follows from; nothing where it has none."""
    from ..motion.posterior import kept_posterior

    if kept := kept_posterior(motion):
        with io.BytesIO() as content:
            np.savez(content, allow_pickle=False, **kept.arrays())  # numpy writes no times: equal bytes
            write_file(path, content.getvalue())


def read_posterior(path: Path, dimension: int) -> KeptPosterior | None:
    """Read what a run kept of its posterior; None where it is of an earlier version, or had none. Raises
    InputError where it was damaged.
    """
    from ..motion.wall.kept import KeptPosterior

    if not path.is_file():
        return None
    try:
        with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as arrays:
            return KeptPosterior.from_arrays(arrays, dimension)
    except FAULTS as error:
        raise InputError(f"{path}: is damaged ({error}); run it again") from None
