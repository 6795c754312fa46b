"""Which page acts: the first that came, until it has gone and another asks; all others look."""

from __future__ import annotations

from collections import Counter
from threading import Lock


class Roles:
    """Roles list pages by the names they gave themselves, how often each is connected, and the one that
    acts.
    """

    def __init__(self) -> None:
        self._lock = Lock()
        self._here: Counter[str] = Counter()
        self._acting: str | None = None

    def enter(self, page: str) -> None:
        with self._lock:
            self._here[page] += 1
            self._acting = self._acting or page

    def leave(self, page: str) -> None:
        """Note that a page has gone; it keeps the role, since it may be loading anew."""
        with self._lock:
            self._here -= Counter([page])

    def ask(self, page: str) -> bool:
        """Return whether a page that is here acts from now on: it has the role, or who had it has gone."""
        with self._lock:
            if self._here[page] and not self._here[self._acting or ""]:
                self._acting = page
            return self._acting == page

    def acts(self, page: str) -> bool:
        with self._lock:
            return self._acting == page

    def free(self) -> bool:
        """Return whether the page that acts has gone."""
        with self._lock:
            return not self._here[self._acting or ""]
