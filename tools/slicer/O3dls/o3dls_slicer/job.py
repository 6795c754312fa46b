"""The Python that has o3dls, which is not Slicer's, and what it is told to do."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from queue import Empty, Queue
from threading import Thread

NAMED = "O3DLS_PYTHON"  # variable with the path of the Python that has o3dls
# what Slicer sets for its own Python and libraries, and another Python must not see
OWN = ("PYTHON", "LD_LIBRARY_PATH", "DYLD_", "QT_", "SLICER_", "SSL_CERT_FILE", "ITK_AUTOLOAD_PATH")
NOT_VALID = 1  # exit code of a run that ended and says that its result is not valid
ASKED = "import o3dls; print(o3dls.__version__)"
WAIT = 60  # seconds for a Python to answer


class NotFound(Exception):
    """No Python has o3dls, in a sentence with what to do."""


def without_slicer(environment: Mapping[str, str]) -> dict[str, str]:
    """Return the variables of a process without those that are meant for Slicer's own Python."""
    return {
        key: value for key, value in environment.items() if not key.upper().startswith(OWN) or key == NAMED
    }


def candidates(named: str, environment: Mapping[str, str]) -> list[Path]:
    """Return the Pythons that may have o3dls: the one that is named, the one of O3DLS_PYTHON, and that beside
    the command o3dls on the path.
    """
    if named:
        return [Path(named)]
    found = [Path(environment[NAMED])] if environment.get(NAMED) else []
    command = shutil.which("o3dls", path=environment.get("PATH", ""))
    if command:
        folder = Path(command).resolve().parent
        found += [folder / name for name in ("python", "python3", "python.exe")]
    return [python for python in found if python.exists()]


def find_python(named: str, environment: Mapping[str, str]) -> tuple[Path, str]:
    """Return the first Python that has o3dls, with its version. Raises NotFound."""
    clean = without_slicer(environment)
    for python in candidates(named, environment):
        done = subprocess.run(
            [str(python), "-c", ASKED], capture_output=True, text=True, env=clean, timeout=WAIT, check=False
        )
        if done.returncode == 0:
            return python, done.stdout.strip()
    where = f"'{named}' has no o3dls" if named else f"none on the PATH, and {NAMED} names none"
    raise NotFound(
        f"no Python with o3dls: {where}. Make one (python3 -m venv o3dls_env, o3dls_env/bin/pip install "
        "o3dls) and name its python; Slicer's own is left alone"
    )


def commands(python: Path, case: Path, run: Path, more: Sequence[str] = ()) -> list[list[str]]:
    """Return what is run for a case: the pipeline, with more options, and then the scene of its result."""
    o3dls = [str(python), "-m", "o3dls"]
    return [
        [*o3dls, "run", "--case", str(case), "--out", str(run), *more],
        [*o3dls, "export", str(run), "--format", "mrb", "--out", str(scene_of(run))],
    ]


def scene_of(run: Path) -> Path:
    """Return where the scene of a run is written."""
    return run.with_suffix(".mrb")


class Job:
    """A job runs commands one after the other beside the application; it is asked how far it is."""

    def __init__(self, steps: Sequence[Sequence[str]], environment: Mapping[str, str] | None = None) -> None:
        self._steps = steps
        self._environment = without_slicer(os.environ if environment is None else environment)
        self._lines: Queue[str] = Queue()
        self._process: subprocess.Popen[str] | None = None
        self._cancelled = False
        self.valid = True
        self.failure = ""
        self._thread = Thread(target=self._work, daemon=True)
        self._thread.start()

    @property
    def running(self) -> bool:
        return self._thread.is_alive()

    def lines(self) -> list[str]:
        """Return what was said since the last time."""
        found = []
        while True:
            try:
                found.append(self._lines.get_nowait())
            except Empty:
                return found

    def cancel(self) -> None:
        """End the command that runs, and begin no other."""
        self._cancelled = True
        if self._process is not None:
            self._process.terminate()

    def _work(self) -> None:
        for step in self._steps:
            try:
                code, last = self._run(step)
            except OSError as error:
                self.failure = str(error)
                return
            if self._cancelled:
                self.failure = "cancelled"
                return
            if code == NOT_VALID and "run" in step:
                self.valid = False
            elif code:
                self.failure = last or f"ended with exit code {code}"
                return

    def _run(self, step: Sequence[str]) -> tuple[int, str]:
        """Run a command, and return its exit code and its last line."""
        last = ""
        with subprocess.Popen(
            step,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            encoding="utf-8",
            errors="replace",
            env=self._environment,
        ) as self._process:
            assert self._process.stdout is not None
            for line in self._process.stdout:
                last = line.rstrip() or last
                self._lines.put(line.rstrip())
        return self._process.returncode, last
