"""What a failed run leaves for those who look for its cause: what it was made of and where it ended, without
anything of the patient, so that the file can be sent with a report.
"""

from __future__ import annotations

import json
import logging
import platform
import traceback
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from ..case import Case
from ..errors import InputError
from ..io.atomic import write_file
from ..places import beside
from .record import plain
from .scoring import provenance

SCHEMA = "o3dls/crash/1"
CRASH = ".crash.json"  # ends the name of the file
PACKAGE = Path(__file__).parents[1]
log = logging.getLogger("o3dls")


@contextmanager
def crash_of_failure(out: Path, case: Case, pipeline: Mapping[str, Any]) -> Iterator[None]:
    """Leave `<out>.crash.json` where the block fails, and name it in the log; remove an old one where it does
    not. An interruption is no failure, and what is wrong with the input the error says.
    """
    path = beside(out, CRASH)
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        with suppress(OSError, InputError, MemoryError):
            path.unlink(missing_ok=True)  # a link is replaced, and not followed
            write_file(path, json.dumps(crash(error, case, pipeline), indent=1) + "\n")
            log.info("%s: what it takes to find the cause, without data of the patient", path)
        raise
    with suppress(OSError):
        path.unlink(missing_ok=True)


def crash(error: BaseException, case: Case, pipeline: Mapping[str, Any]) -> dict[str, Any]:
    """Return the content of a crash file. Names of files and of points are left out, and the sentences of
    errors, which may hold them; so are texts among the parameters but for the names of stages.
    """
    made = provenance(case, dict(pipeline)).table()
    return {
        "schema": SCHEMA,
        "errors": _describe_chain(error),
        "inputs": sorted([Path(name).suffix, digest] for name, digest in case.files.items()),
        "case": {"dimension": case.dimension, "units": case.units, "points": made["case"]["points"]},
        "pipeline": {key: _keep_numbers(plain(pipeline[key])) for key in pipeline},
        "versions": made["versions"],
        "platform": f"{platform.system()} {platform.release()} {platform.machine()}",
        "threads": made["threads"],
    }


def _describe_chain(error: BaseException | None) -> list[dict[str, Any]]:
    """Return the class of an error and the lines of code that it went through, and those of its causes."""
    found: list[dict[str, Any]] = []
    while error is not None and len(found) < 10:
        frames = traceback.extract_tb(error.__traceback__)
        lines = [f"{_code_name(frame.filename)}:{frame.lineno} {frame.name}" for frame in frames]
        found.append({"error": type(error).__name__, "lines": lines})
        error = error.__cause__ or error.__context__
    return found


def _code_name(file: str) -> str:
    """Return the path of a file of code in its package; the folders of a user are nobody's business."""
    path = Path(file)
    if path.is_relative_to(PACKAGE):
        return path.relative_to(PACKAGE.parent).as_posix()
    parts = path.parts
    return "/".join(parts[parts.index("site-packages") + 1 :]) if "site-packages" in parts else path.name


def _keep_numbers(value: Any, key: str = "") -> Any:
    if isinstance(value, dict):
        return {name: _keep_numbers(one, name) for name, one in value.items() if key != "weights"}
    if isinstance(value, list):
        return [_keep_numbers(one) for one in value]
    return value if not isinstance(value, str) or key == "use" else "..."
