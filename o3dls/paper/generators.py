"""Synthetic cases by name. Generators register under `o3dls.generators`, as stages do, so that o3dls needs none to work."""

from __future__ import annotations

from typing import Any

from ..errors import InputError
from ..stage import registered

GROUP = "o3dls.generators"


def generate(name: str, seed: int, **options: Any) -> Any:
    """What the generator of that name makes of a seed. Raises InputError where no such generator is installed."""
    known = registered(GROUP)
    if name not in known:
        raise InputError(f"no generator '{name}' under {GROUP}: o3dls is not installed as a package; ./dev or pip install does")
    return known[name].load()(seed, **options)
