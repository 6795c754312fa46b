"""The interface of a writer: `(run, folder) -> None`."""

from __future__ import annotations

from abc import abstractmethod
from pathlib import Path
from typing import TYPE_CHECKING

from ..plugins.plugin import Plugin

if TYPE_CHECKING:
    from .run import Run


class Writer(Plugin):
    """A writer makes files of a finished run inside its folder; the run's surfaces have the fields of their
    files.
    """

    @property
    def refers_to(self) -> tuple[str, ...]:
        """Names of the estimates that the writer shows, so that a misspelt one is found before the run."""
        return ()

    def target(self, final: str) -> tuple[str, ...]:
        """Return what its files are of and named after; two writers of one target would overwrite each
        other's. `final`: the last estimate.
        """
        return (self.name, *map(str, self.record().values()))

    def prepare(self) -> None:
        """Import what writing takes. A pipeline calls this on a thread while its stages run, so that a run
        does not wait for imports at its end.
        """

    @abstractmethod
    def __call__(self, run: Run, folder: Path) -> None: ...
