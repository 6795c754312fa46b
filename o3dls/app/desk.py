"""What the pages of one app do: every action of a page is a function here, and everything that takes time is
done by the reader, or for a run by a worker of its own.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from threading import Lock, Thread
from typing import Any

from ..errors import InputError, O3dlsError
from ..pipeline.supervision import Limits
from ..places import remove_partial
from . import bring, fuse, place, take
from .job import Job
from .live_session import Sessions
from .pages import case_page, home_page, run_page
from .shelf import CASES, RUNS, Shelf
from .worker import Lost, Message, Reader, Worker

ROLES = ("prior", "map", "landmarks")
MOST_PAIRS = 100
log = logging.getLogger("o3dls")


class Desk:
    """The desk holds the folder of an app, its reader, and the run that is at work. Safe to use from several
    threads; all pages see the same.

    limits: of the time and memory of a run.
    """

    def __init__(self, folder: Path, limits: Limits | None = None) -> None:
        self.shelf = Shelf(folder)
        self.job: Job | None = None
        self._limits = limits or Limits()
        self._reader = Reader(self.shelf.folder)
        self._worker: Worker | None = None
        self._lock = Lock()
        self._sessions = Sessions(self.shelf)

    def home(self) -> str:
        """Write the page that lists what there is, and by which files are brought."""
        return home_page(self.shelf.folder, self.shelf.listed())

    def case(self, path: str) -> str:
        """Write the page of a case."""
        case = self.shelf.case(path)
        runs = self.shelf.listed()[RUNS]
        return str(self._reader.do(partial(case_page, case, runs)))

    def run(self, path: str) -> str:
        """Write the page of a run."""
        return str(self._reader.do(partial(run_page, self.shelf.run(path))))

    def report(self, path: str) -> str:
        """Return the report of a run, the page that `o3dls report` writes."""
        return str(self._reader.do(partial(_read_report, self.shelf.run(path))))

    def grade(self, path: str) -> Message:
        """Return the grade and the small picture of a run."""
        found: Message = self._reader.do(partial(_read_grade, self.shelf.run(path)))
        return found

    def export(self, path: str) -> Path:
        """Return the whole path of a file that was exported of a run. Raises InputError for any other."""
        found = self.shelf.place(path)
        if found.parent.name != "export" or not (self.shelf.folder / found).is_file():
            raise InputError(f"{found}: is not a file that was exported of a run")
        self.shelf.run(str(found.parent.parent))
        return self.shelf.folder / found

    def look(self, asked: Mapping[str, Any]) -> Message:
        """Read a file in its role: {role, file, settings}."""
        role = asked.get("role")
        if role not in ROLES:
            raise InputError(f"role = {role!r}: must be one of {', '.join(ROLES)}")
        settings = bring.check_settings(asked.get("settings", {}))
        path = self.shelf.place(_read_text(asked, "file"))
        found: Message = self._reader.do(partial(bring.look, role, path, settings))
        return found

    def make(self, asked: Mapping[str, Any]) -> Message:
        """Make a case: {name, prior, map, landmarks, settings}; its path."""
        settings = bring.check_settings(asked.get("settings", {}))
        given = {role: asked.get(role) for role in ROLES}
        files = {role: self.shelf.place(str(one)) if one else None for role, one in given.items()}
        name = self.shelf.new_folder(CASES, _read_text(asked, "name"))
        run = self.shelf.new_folder(RUNS, name.name)
        made: Message = self._reader.do(partial(bring.make, name, run, files, settings))
        return {"case": name.as_posix(), **made}

    def place(self, asked: Mapping[str, Any]) -> Message:
        """Place the prior of a case by pairs: {case, pairs}; or only say how they fit: {pairs}."""
        pairs = asked.get("pairs")
        if not isinstance(pairs, list) or len(pairs) > MOST_PAIRS:
            raise InputError(f"pairs: must be a list of at most {MOST_PAIRS} pairs of places")
        if "case" not in asked:
            _, misses, left_out = place.fit_pairs(pairs)
            return {"misses": misses, "left_out": left_out}
        case = self.shelf.case(_read_text(asked, "case"))
        found: Message = self._reader.do(partial(place.place, case, pairs))
        return found

    def take(self, asked: Mapping[str, Any]) -> Message:
        """Export a run: {run, export}."""
        run = self.shelf.run(_read_text(asked, "run"))
        found: Message = self._reader.do(partial(take.take, run, take.check_export(asked.get("export"))))
        return found

    def fuse(self, asked: Mapping[str, Any]) -> Message:
        """Begin a run of a case: {case, preset}; where it goes."""
        case, preset = self.shelf.case(_read_text(asked, "case")), asked.get("preset")
        if preset not in (*fuse.PRESETS, fuse.OWN):
            raise InputError(f"preset = {preset!r}: must be one of {', '.join((*fuse.PRESETS, fuse.OWN))}")
        with self._lock:
            if self.job and self.job.state == "running":
                raise InputError(f"{self.job.run}: is at work; wait for its end, or cancel it")
            run = self.shelf.new_folder(RUNS, case.name if preset == "default" else f"{case.name}-{preset}")
            line = fuse.run_command(case, run, preset)
            self.job = Job(case.as_posix(), run.as_posix(), line)
            self._worker = Worker(self.shelf.folder, self._limits)
        task = partial(fuse.run_case, case, run, preset)
        Thread(target=self._follow_run, args=(self.job, self._worker, task), daemon=True).start()
        return {"run": run.as_posix()}

    def cancel(self) -> Message:
        """End the run that is at work; nothing of it is left."""
        job, worker = self.job, self._worker
        if job is None or worker is None or job.state != "running":
            raise InputError("no run is at work")
        job.cancel()
        worker.end()
        return {"ok": True}

    def live(self, asked: Mapping[str, Any]) -> Message:
        """Begin a live session of a case, or find the one that is open: {case, source, place}; the link."""
        source, place = _read_text(asked, "source"), _read_text(asked, "place")
        return self._sessions.begin(self.shelf.case(_read_text(asked, "case")), source, place)

    def close(self) -> None:
        """End what is at work."""
        self._reader.end()
        self._sessions.close()
        if self._worker:
            self._worker.end()

    def _follow_run(self, job: Job, worker: Worker, task: Any) -> None:
        """Follow a run to its end, however it ends."""
        try:
            job.end(worker.do(task, job.take))
        except Lost:
            job.lose()
        except O3dlsError as error:
            job.refuse(str(error))
        finally:
            worker.end()
            remove_partial(self.shelf.folder / job.run)


def _read_text(asked: Mapping[str, Any], key: str) -> str:
    found = asked.get(key)
    if not isinstance(found, str) or not found:
        raise InputError(f"{key}: must be given, as text")
    return found


def _read_report(run: Path, tell: Any) -> str:
    from ..report.browser import page_of

    return page_of(run).read_text(encoding="utf-8")


def _read_grade(run: Path, tell: Any) -> Message:
    import base64

    from ..report.cohort.entries import read_entries
    from ..report.grading.check import WORDS

    (entry,) = read_entries([run])
    picture = base64.b64encode(entry.picture).decode("ascii")
    return {"grade": WORDS[entry.grade], "doubts": list(entry.doubts), "picture": picture}
