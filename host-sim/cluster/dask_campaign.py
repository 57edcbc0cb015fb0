#!/usr/bin/env python3
"""Runs the missing blocks of a campaign on a Dask cluster, then merges them.

    skyroost campaign plan figure6.toml --out /shared/figure6
    python dask_campaign.py --dir /shared/figure6 --scheduler tcp://head:8786

Without --scheduler it starts a cluster on this machine. Workers need the same program (--skyroost) and must see the
directory. A block is a command that may be killed and repeated; Dask gives the blocks of a lost worker to others, and
whatever is missing after all that is run again, until nothing is. Needs the package `distributed`.
"""

import argparse
import json
import subprocess
import sys

from distributed import Client, LocalCluster, as_completed

PARTIAL = 5  # exit status of `missing` and `merge` while blocks are missing
ROUNDS = 3  # a block that fails as often as this fails for a reason of its own


def skyroost(program, step, directory, *options):
    """One command, its exit status checked; returns what it prints."""
    command = [program, "campaign", step, "--dir", directory, "--quiet", *options]
    ran = subprocess.run(command, capture_output=True, text=True, check=False)
    if ran.returncode not in (0, PARTIAL):
        raise RuntimeError(f"{' '.join(command)}: exit status {ran.returncode}: {ran.stderr.strip()}")
    return ran.stdout


def missing(program, directory):
    return json.loads(skyroost(program, "missing", directory, "--json"))["missing"]


def run_all(client, program, directory):
    """Runs the blocks that are missing, once each; says how many did not come back."""
    blocks = missing(program, directory)
    # Impure, so that Dask runs what is asked for instead of remembering it from an earlier round.
    futures = [
        client.submit(skyroost, program, "run", directory, "--block", str(block), "--threads", "1", pure=False)
        for block in blocks
    ]
    failed = 0
    for done, future in enumerate(as_completed(futures), start=1):
        if future.status != "finished":
            failed += 1
            print(f"a block failed: {future.exception()}", file=sys.stderr)
        print(f"{done} of {len(blocks)} blocks", file=sys.stderr)
    return failed


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--dir", required=True, help="directory of the campaign, seen by all workers")
    parser.add_argument("--scheduler", help="address of a Dask scheduler; without it, a cluster on this machine")
    parser.add_argument("--workers", type=int, default=2, help="workers of a cluster on this machine")
    parser.add_argument("--skyroost", default="skyroost", help="the program, the same on every worker")
    args = parser.parse_args()
    cluster = args.scheduler or LocalCluster(n_workers=args.workers, threads_per_worker=1)
    with Client(cluster) as client:
        for _ in range(ROUNDS):
            run_all(client, args.skyroost, args.dir)
            if not missing(args.skyroost, args.dir):
                break
        else:
            sys.exit(PARTIAL)
    print(skyroost(args.skyroost, "merge", args.dir), end="")


if __name__ == "__main__":
    main()
