"""The record folder of a session: begun from a case, or gone on from by its journal."""

from __future__ import annotations

from datetime import datetime
from hashlib import sha256
from pathlib import Path

from ..case import Case
from ..errors import InputError
from ..io.case_reader import read_case
from .journal import NAME, Journal, begin_journal, resume_journal
from .messages import Message
from .session import Session, actions_of, empty


def default_record() -> Path:
    """Return the path of a record folder that is named by the time."""
    return Path(f"live_{datetime.now().astimezone():%Y-%m-%d_%H-%M-%S}")


def open_record(record: Path, folder: Path | None) -> tuple[Journal, Session]:
    """Open the session of a record folder, gone on from where it has a journal; else that of a case folder,
    whose points and landmarks are its first actions.

    Raises InputError where neither is there, the prior is another one now, or the case cannot be used live.
    """
    if not (record / NAME).exists():
        if folder is None:
            raise InputError(f"{record}: holds no {NAME}: name the case folder that the session is of")
        case = _read_live_case(folder)
        head = {"case": str(folder.resolve()), "prior": digest(case)}
        return _apply_journal(begin_journal(record, head, list(actions_of(case))), case)
    journal = resume_journal(record)
    try:
        case = _read_live_case(folder or Path(journal.head["case"]))
        if digest(case) != journal.head["prior"]:
            raise InputError(
                f"{journal.path}: its prior is not that of {folder or journal.head['case']}: name the case "
                "folder that the session was begun with, or another --record folder"
            )
        return _apply_journal(journal, case)
    except BaseException:
        journal.close()
        raise


def digest(case: Case) -> str:
    """Return a hash of a case's prior, which tells priors apart."""
    return sha256(case.prior.vertices.tobytes() + case.prior.faces.tobytes()).hexdigest()


def _apply_journal(journal: Journal, case: Case) -> tuple[Journal, Session]:
    session = Session(empty(case))
    for k, one in enumerate(journal.actions):
        checked: Message = {key: value for key, value in one.items() if key not in ("seq", "time")}
        try:
            session.check(checked)
        except InputError as error:
            raise InputError(f"{journal.path}: line {k + 2}: {error}") from None
        session.apply(checked)
    return journal, session


def _read_live_case(folder: Path) -> Case:
    case = read_case(folder, fewest=0)
    if case.dimension != 3 or case.units != "mm":
        raise InputError(f"{folder}: a session needs a case in 3D and in mm")
    return case
