"""The grey image that a case refers to: found, compared with the prior, opened where it is to be drawn."""

from __future__ import annotations

import logging
import os
from dataclasses import replace
from pathlib import Path

from ...case import Case
from ...errors import InputError
from ..case_settings import Folder
from ..meshes.surface_file import SurfaceFile
from .image import GreyImage, image_hash, open_image

log = logging.getLogger("o3dls")
LABELS = "labels"  # what an image `shows` that is the label volume of the prior


def image_of(folder: Folder, prior: SurfaceFile) -> dict[str, str]:
    """Return the path of the image that case.toml names, else of the label volume that the prior is the wall
    of; nothing where there is neither. Raises InputError for an image of a case that has none.
    """
    name = folder.settings.get("image")
    if name is not None:
        if folder.dimension != 3 or folder.units == "px":
            raise InputError(f"{folder.path}: image = '{name}': an image belongs to a prior in 3D, in mm")
        return {"path": os.path.abspath(folder.path / name)}
    chosen = any(folder.settings.get(key) for key in ("form", "sidecar"))
    path = folder.find("prior") if "label" in prior.metadata and not chosen else None
    return {} if path is None else {"path": os.path.abspath(path), "shows": LABELS}


def with_image(case: Case) -> Case:
    """Return the case with the hash of its image, which is looked through. Raises InputError where it is
    missing or damaged, or the prior does not lie in it; of a label volume, whose reader has said all, only
    leaves it out.
    """
    if not case.image:
        return case
    try:
        image = open_case_image(case)
    except InputError:
        if case.image.get("shows") == LABELS:
            return replace(case, image={})
        raise
    log_gap(image, case)
    return replace(case, image={**case.image, "sha256": image_hash(Path(case.image["path"]))})


def open_case_image(case: Case, *, whole: bool = True) -> GreyImage:
    """Open the image of a case that has one; parameters and errors as of `open_image`."""
    path = Path(case.image["path"])
    if not path.exists():
        raise InputError(f"{path}: no such file or folder: the image of case {case.name} must be there")
    return open_image(path, case.prior.vertices, case.prior_frame, whole=whole)


def open_kept_image(case: Case) -> GreyImage:
    """Open the image of a run's case, which must be as it was. Raises InputError where it is not there any
    more, or was changed.
    """
    path = Path(case.image["path"])
    if not path.exists() and "sha256" not in case.image:
        raise InputError(f"{path}: no such file or folder")
    if not path.exists():
        raise InputError(f"the image is no longer at {path}")
    if case.image.get("sha256") not in (None, image_hash(path)):
        raise InputError(f"the image {path} was changed since the run")
    return open_case_image(case, whole=False)


def log_gap(image: GreyImage, case: Case) -> None:
    """Warn of an image that does not hold all of the prior."""
    if gap := image.gap(case.prior.vertices):
        log.warning("%s: %s", image.path, gap)
