"""What the pages of one app do: every action of a page is a function here, and everything that takes time is
done by the reader, or for a run by a worker of its own.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from threading import Lock, Thread
from typing import Any

from ..errors import InputError, O3dlsError
from ..pipeline.supervision import Limits
from ..places import remove_partial
from . import bring, fuse, pose, take, uploads
from .job import Job
from .live_session import Sessions
from .pages import case_page, cohort_of, compare_page, home_page, run_page
from .shelf import CASES, RUNS, Shelf
from .worker import Lost, Message, Reader, Worker

ROLES = ("prior", "map", "landmarks", "image")
MOST_RUNS = 50  # that one page compares
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
        self._searcher: Reader | None = None  # of poses; other pages need not wait for it
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
        targets = {one: self.shelf.new_folder(RUNS, fuse.run_name(case, one)) for one in fuse.PRESETS}
        return str(self._reader.do(partial(case_page, case, runs, targets)))

    def run(self, path: str) -> str:
        """Write the page of a run."""
        cases = self.shelf.listed()[CASES]
        return str(self._reader.do(partial(run_page, self.shelf.run(path), cases)))

    def compare(self, paths: Sequence[str]) -> str:
        """Return the page that compares runs, as `o3dls compare` writes it."""
        if not 1 < len(paths) <= MOST_RUNS:
            raise InputError(f"{len(paths)} runs are chosen: choose 2 or more, at most {MOST_RUNS}")
        runs = [self.shelf.run(path) for path in dict.fromkeys(paths)]
        return str(self._reader.do(partial(compare_page, runs)))

    def cohort(self, path: str) -> str:
        """Return the page of all runs in a folder, as `o3dls cohort` writes it."""
        return str(self._reader.do(partial(cohort_of, self.shelf.place(path))))

    def report(self, path: str) -> str:
        """Return the report of a run, the page that `o3dls report` writes."""
        return str(self._reader.do(partial(_read_report, self.shelf.run(path))))

    def grade(self, path: str) -> Message:
        """Return the grade and the small picture of a run."""
        found: Message = self._reader.do(partial(_read_grade, self.shelf.run(path)))
        return found

    def glance(self, path: str) -> Message:
        """Return how many points a case has, and a small picture of its prior."""
        found: Message = self._reader.do(partial(_draw_case, self.shelf.case(path)))
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

    def unpack(self, asked: Mapping[str, Any]) -> Message:
        """Make a folder of the slices in a zip that was brought: {file}."""
        packed = self.shelf.place(_read_text(asked, "file"))
        task = partial(uploads.unpack_slices, packed, self.shelf.new_slices(packed))
        found: Message = self._reader.do(task)
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

    def fit(self, asked: Mapping[str, Any]) -> Message:
        """Return the pose that pairs give: {pairs}; and how far off each is, with and without it."""
        return pose.fit_pairs(asked.get("pairs"))

    def pose(self, asked: Mapping[str, Any]) -> Message:
        """Search for the pose of a case: {case}; or say how sure the points are of one: {case, T}."""
        case = self.shelf.case(_read_text(asked, "case"))
        given = pose.read_pose(asked["T"]) if "T" in asked else None
        task = partial(pose.find_pose, case) if given is None else partial(pose.judge_pose, case, given)
        with self._lock:
            self._searcher = self._searcher or Reader(self.shelf.folder, self._limits)
        found: Message = self._searcher.do(task)
        return found

    def place(self, asked: Mapping[str, Any]) -> Message:
        """Write the pose of a case: {case, T}."""
        case, T_map_prior = self.shelf.case(_read_text(asked, "case")), pose.read_pose(asked.get("T"))
        found: Message = self._reader.do(partial(pose.write_pose, case, T_map_prior))
        return found

    def take(self, asked: Mapping[str, Any]) -> Message:
        """Export a run: {run, export}."""
        run = self.shelf.run(_read_text(asked, "run"))
        found: Message = self._reader.do(partial(take.take, run, take.check_export(asked.get("export"))))
        return found

    def fuse(self, asked: Mapping[str, Any]) -> Message:
        """Begin a run of a case: {case, preset}; where it goes."""
        case, preset = self.shelf.case(_read_text(asked, "case")), _read_text(asked, "preset")
        if preset not in fuse.PRESETS:
            raise InputError(f"preset = {preset!r}: must be one of {', '.join(fuse.PRESETS)}")
        with self._lock:
            if self.job and self.job.state == "running":
                raise InputError(f"{self.job.run}: is at work; wait for its end, or cancel it")
            run = self.shelf.new_folder(RUNS, fuse.run_name(case, preset))
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
        self._sessions.close()
        for one in (self._reader, self._searcher, self._worker):
            if one:
                one.end()

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
    return {"said": [WORDS[entry.grade], *entry.doubts[:2]], "picture": f"data:image/webp;base64,{picture}"}


def _draw_case(case: Path, tell: Any) -> Message:
    from ..io.case_reader import read_case
    from .picture import draw

    found = read_case(case)
    picture = draw(found.frame, surface=found.prior)
    said = [f"{len(found.points)} points"]
    return {"said": said, "picture": f"data:image/png;base64,{picture}" if picture else ""}
