"""Open3D without dash until that is needed."""

from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType
from typing import Any

PLOTS = "dash"  # a web server, for open3d.visualization.draw_plotly alone: a quarter of Open3D's import


class Later:
    """This name of a module is imported only when it is used."""

    def __init__(self, module: str, name: str) -> None:
        self._module, self._name = module, name

    def __getattr__(self, name: str) -> Any:
        return getattr(self._import_own(), name)

    def __call__(self, *given: Any, **named: Any) -> Any:
        return self._import_own()(*given, **named)

    def _import_own(self) -> Any:
        return getattr(import_module(self._module), self._name)


class _Names(ModuleType):
    """This module stands for another one, whose names it imports only when they are used."""

    def __getattr__(self, name: str) -> Later:
        if name.startswith("__"):
            raise AttributeError(name)
        return Later(self.__name__, name)


def open3d() -> ModuleType:
    """Import the module open3d; its own names are as they are, and what it takes of dash comes when it is
    used.
    """
    if "open3d" in sys.modules or PLOTS in sys.modules:
        return import_module("open3d")
    sys.modules[PLOTS] = _Names(PLOTS)
    try:
        return import_module("open3d")
    finally:
        del sys.modules[PLOTS]
