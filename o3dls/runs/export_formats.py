"""The formats of exported files: their names, suffixes and what they need."""

from __future__ import annotations

from typing import Literal

FormatName = Literal[
    "ply",
    "stl",
    "obj",
    "off",
    "vtk",
    "vtp",
    "carto_mesh",
    "openep",
    "opencarp",
    "carto_vtk",
    "dif",
    "phi_nrrd",
    "phi_nifti",
    "mask_nrrd",
    "mask_nifti",
    "tfm",
    "txt",
]
FrameName = Literal["LPS", "RAS"]
SUFFIXES = {
    "carto_vtk": "carto.vtk",
    "carto_mesh": "mesh",
    "openep": "mat",
    "opencarp": "pts",
    "dif": "dif.xml",
    "phi_nrrd": "phi.nrrd",
    "phi_nifti": "phi.nii.gz",
    "mask_nrrd": "mask.nrrd",
    "mask_nifti": "mask.nii.gz",
}
VOLUMES_AND_POSES = {
    "phi_nrrd": (".nrrd",),
    "mask_nrrd": (".nrrd",),
    "phi_nifti": (".nii", ".nii.gz"),
    "mask_nifti": (".nii", ".nii.gz"),
    "tfm": (".tfm",),
    "txt": (".txt",),
}
NEED_FRAME = ("phi_nifti", "mask_nifti", "tfm")  # formats that say LPS or RAS by definition


def file_name(estimate: str, format: str) -> str:
    """Name of an exported file; the CARTO dialect is told from plain VTK."""
    return f"{estimate}.{SUFFIXES.get(format, format)}"
