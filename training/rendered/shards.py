"""Training images from the command line, in shards: one seed, one file."""

from __future__ import annotations

import argparse
import logging
from collections.abc import Callable
from pathlib import Path

import cv2


def write_missing(
    description: str, name: str, write: Callable[[Path, int, int], object], *, out: Path, shards: int, per_shard: int
) -> None:
    """Write the shards that the command line asks for; those that exist are left as they are.

    Args:
        name: of the files, before an underscore and the seed.
        write: writes one: folder, seed, images.
        out: folder, unless the command line names one; so too what follows.
    """
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--out", type=Path, default=out)
    parser.add_argument("--shards", type=int, default=shards)
    parser.add_argument("--per-shard", type=int, default=per_shard)
    parser.add_argument("--seed", type=int, default=0, help="number of the first shard")
    args = parser.parse_args()
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    cv2.setNumThreads(1)
    for seed in range(args.seed, args.seed + args.shards):
        if not (args.out / f"{name}_{seed:06d}.npz").exists():
            write(args.out, seed, args.per_shard)
