"""Rollcall's own packages before a script's folders of the same names.

Python keeps one module per name, and a script's own folder comes first on its path: a ``vision`` beside the script
would hide ours. So ours are loaded here by their place; what is in them is found through them from then on.
"""

from __future__ import annotations

import importlib.util
import sys
from importlib.machinery import PathFinder
from pathlib import Path

PACKAGES = ("infra", "mavlink", "vision", "assoc", "sim", "gcs")


def load(root: Path, name: str) -> None:
    """Load a package from a folder, unless it is loaded already.

    Raises:
        ImportError: another package of that name is loaded.
    """
    if loaded := sys.modules.get(name):
        places = [Path(place).resolve() for place in getattr(loaded, "__path__", ())]
        if root / name not in places:
            found = places[0] if places else getattr(loaded, "__file__", "a module")
            raise ImportError(
                f"{found} is loaded as {name!r}, the name of one of Rollcall's own packages: "
                f"import rollcall before it, or give it another name"
            )
        return
    spec = PathFinder.find_spec(name, [str(root)])
    if spec is None or spec.loader is None:
        raise ImportError(f"{root / name}: no such package; Rollcall is not installed as a whole")
    sys.modules[name] = module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)


for _name in PACKAGES:
    load(Path(__file__).resolve().parents[1], _name)
