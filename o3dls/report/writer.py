"""The door to the report: as a writer of a pipeline, and as a function on finished run folders."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from pydantic import Field

from ..errors import InputError
from ..runs.writers import Writer

if TYPE_CHECKING:
    from ..pipeline.outcome import Outcome
    from ..runs.run import Run
    from .cohort.entries import Entry
    from .subject import Subject

REPORT, FIGURES = "report.html", "figures"
PAGES = (".html", ".htm")


class Report(Writer):
    """Write report.html: the estimates side by side, with every number and how it was made."""

    name: ClassVar = "report"
    compare: tuple[str, ...] = Field(
        default=(), max_length=4, description="estimates to show side by side; default: the ICP and the last"
    )

    pdf: bool = Field(
        default=False, description="also write report.pdf, one page for slides, and figures/*.png"
    )

    activation: bool = Field(
        default=False,
        description="also map activation times and speeds, of points with a column lat; takes some seconds",
    )

    @property
    def refers_to(self) -> tuple[str, ...]:
        return self.compare

    def target(self, final: str) -> tuple[str, ...]:
        return (self.name,)

    def prepare(self) -> None:
        from . import page  # noqa: F401

    def __call__(self, run: Run, folder: Path) -> None:
        from .subject import read_subject
        from .surfaces.given import with_given

        subject = read_subject([folder], self.compare, [with_given(run)])
        _write_page(replace(subject, activation=self.activation), folder / REPORT, pdf=self.pdf)


def write_report(
    folders: Sequence[str | Path],
    out: str | Path | None = None,
    *,
    compare: Sequence[str] = (),
    pdf: bool = False,
    activation: bool = False,
) -> Path:
    """Write one HTML page on finished run folders of one case; `out` defaults to report.html in the first
    folder.

    `compare` names the estimates to show side by side; `pdf` adds a one-page PDF and pictures beside the
    page, those of report.html in figures/ and of NAME.html in NAME_figures/, since several reports may stand
    in one folder; `activation` adds the maps of `o3dls activation`. Raises InputError where a folder is no
    run, the cases differ, or `out` is no name for a page.
    """
    from ..runs.folder import read_run
    from .subject import read_subject
    from .surfaces.given import with_given

    paths = [Path(folder) for folder in folders]
    subject = read_subject(paths, compare, [with_given(read_run(path)) for path in paths])
    path = _check_page_path(out or subject.folders[0] / REPORT)
    return _write_page(replace(subject, activation=activation), path, pdf=pdf)


def _write_page(subject: Subject, path: Path, *, pdf: bool) -> Path:
    """Write the page of a subject, and its pictures."""
    from ..io.atomic import write_file
    from ..io.manifest import noted
    from .page import report_page

    text = report_page(subject)
    with noted(subject.folders[0]):
        if pdf:
            from .sections.slides import write_slides

            figures = FIGURES if path.name == REPORT else f"{path.stem}_{FIGURES}"
            write_slides(subject, path.parent / figures, path.with_suffix(".pdf"))
        # last, and atomic: an interruption leaves all or nothing
        write_file(path, text, within=_folder_of_run(path, subject))
    return path


def _folder_of_run(path: Path, subject: Subject) -> Path | None:
    """Return the folder of the subject's runs in which a page stands, which may be from elsewhere, so that no
    link there is followed; None for a page beside them.
    """
    return next((folder for folder in subject.folders if path.is_relative_to(folder)), None)


def compare(folders: Sequence[str | Path], out: str | Path = "compare.html") -> Path:
    """Write one HTML page that compares finished runs, of one case or of many: paired by case, the worst
    first, with links to their reports.

    Raises InputError where a folder is no run or named twice, or `out` is no name for a page.
    """
    from .cohort.entries import read_entries

    path = _check_page_path(out)
    return _write_cohort(read_entries([Path(folder) for folder in folders]), {}, path)


def write_cohort(
    outcomes: Sequence[Outcome], out: str | Path, entries: Sequence[Entry] | None = None
) -> Path:
    """Write cohort.html into the folder of a batch: its runs compared, and the cases that failed with the
    reasons. entries: what `cohort_entries` gives, where it is at hand.
    """
    from ..pipeline.outcome import PAGE

    found = cohort_entries(outcomes, out) if entries is None else entries
    failed = {one.case: one.error for one in _in_order_of_table(outcomes) if one.error}
    return _write_cohort(found, failed, Path(out) / PAGE, within=Path(out))


def cohort_entries(outcomes: Sequence[Outcome], out: str | Path) -> list[Entry]:
    """Read the runs of a batch, as its page and its last lines need them, in the order of the table."""
    from .cohort.entries import read_entries

    return read_entries([Path(out) / one.case for one in _in_order_of_table(outcomes) if not one.error])


def _in_order_of_table(outcomes: Sequence[Outcome]) -> list[Outcome]:
    return sorted(outcomes, key=lambda one: one.case)


def _write_cohort(
    entries: Sequence[Entry], failed: Mapping[str, str], path: Path, within: Path | None = None
) -> Path:
    from ..io.atomic import write_file
    from .cohort.page import cohort_page

    write_file(path, cohort_page(entries, path, failed), within=within)
    return path


def _check_page_path(out: str | Path) -> Path:
    """Return the path of a page to write. Raises InputError for a name that says it is something else, or is
    a part of a run.
    """
    from ..runs.folder import check_not_of_a_run

    path = Path(out)
    if path.suffix.lower() not in PAGES:
        raise InputError(f"{path}: is written as HTML; name a file that ends in {' or '.join(PAGES)}")
    check_not_of_a_run(path)
    return path
