"""Layers and features of exported maps, by GDAL; a GeoPackage by GDAL's validator, too.

pip install pyogrio && pip install --no-deps gdal-utils
python bench/interop/maps_gdal.py FILE…
"""

from __future__ import annotations

import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path


def main(files: list[str]) -> None:
    import pyogrio

    print(f"GDAL {'.'.join(map(str, pyogrio.__gdal_version__))}\n")
    print("| file | driver | layer | geometry | features | fields | validate_gpkg.py |\n|---|---|---|---|---:|---|---|")
    for path in map(Path, files):
        verdict = _validate(path) if path.suffix == ".gpkg" else ""
        for layer, _ in pyogrio.list_layers(path):
            about = pyogrio.read_info(path, layer=layer, force_feature_count=True)
            kinds = f"{about['driver']} | {layer} | {about['geometry_type']} | {about['features']}"
            print(f"| {path.name} | {kinds} | {len(about['fields'])} | {verdict} |")


def _validate(path: Path) -> str:
    found = find_spec("osgeo_utils.samples.validate_gpkg")
    if found is None or found.origin is None:
        return "not installed"
    done = subprocess.run([sys.executable, found.origin, path], capture_output=True, text=True, check=False)
    return f"exit {done.returncode} {(done.stdout + done.stderr).strip()}".strip()


if __name__ == "__main__":
    main(sys.argv[1:])
