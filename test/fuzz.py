"""Fuzzes the targets for some minutes, and stores what they fail at: see tools/fuzz."""
import argparse
import hashlib
import importlib
import importlib.util
import multiprocessing
import sys
import tempfile
import time
from typing import Any, List, Tuple

import fuzz_targets


def fuzzed_by_coverage(name: str, seconds: float) -> None:
    """Run atheris on a target until the time is over, or until it fails."""
    atheris: Any = importlib.import_module("atheris")  # tools/fuzz has installed it
    atheris.instrument_all()
    stored = fuzz_targets.CORPUS / name
    with tempfile.TemporaryDirectory() as grown:
        limits = [f"-max_total_time={max(1, int(seconds))}", "-max_len=4000", "-timeout=10"]
        quiet = ["-verbosity=0", "-print_final_stats=1"]
        places = [f"-artifact_prefix={stored}/", grown, str(stored)]
        atheris.Setup([sys.argv[0], *limits, *quiet, *places], fuzz_targets.TARGETS[name])
        atheris.Fuzz()


def fuzzed_at_random(name: str, seconds: float) -> None:
    """Run hypothesis on a target with random seeds until the time is over, or until it fails."""
    from hypothesis import HealthCheck, find, settings
    from hypothesis.errors import NoSuchExample
    from test_fuzz import inputs

    target, until = fuzz_targets.TARGETS[name], time.monotonic() + seconds

    def fails(data: bytes) -> bool:
        try:
            target(data)
        except Exception:  # whatever it is, it is what is looked for
            return True
        return False

    checks = list(HealthCheck)
    usual = settings(max_examples=500, database=None, deadline=None, suppress_health_check=checks)
    while time.monotonic() < until:
        try:
            found = find(inputs(name), fails, settings=usual)
        except NoSuchExample:
            continue
        path = fuzz_targets.CORPUS / name / f"found-{hashlib.sha1(found).hexdigest()[:12]}"
        path.write_bytes(found)
        print(f"[fuzz] {name} fails at {path}", flush=True)
        target(found)


def main() -> int:
    """Fuzz one target after the other, each in a process of its own. Returns 1 if one failed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("minutes", nargs="?", type=float, default=10.0, help="in all (10)")
    parser.add_argument("targets", nargs="*", help=f"of {', '.join(fuzz_targets.TARGETS)} (all)")
    args = parser.parse_args()
    chosen: List[str] = args.targets or list(fuzz_targets.TARGETS)
    unknown = sorted(set(chosen) - set(fuzz_targets.TARGETS))
    if unknown:
        parser.error(f"no such target: {', '.join(unknown)}")
    covers = importlib.util.find_spec("atheris") is not None
    work = fuzzed_by_coverage if covers else fuzzed_at_random
    bad: List[str] = []
    for name in chosen:
        print(f"[fuzz] {name}", flush=True)
        given: Tuple[str, float] = (name, 60.0 * args.minutes / len(chosen))
        process = multiprocessing.get_context("spawn").Process(target=work, args=given)
        process.start()
        process.join()
        if process.exitcode:
            bad.append(name)
    print(f"[fuzz] failed: {', '.join(bad) or 'none'}")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
