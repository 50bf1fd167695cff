"""Compares this state with an earlier build: ``python -m tests.oracle [--old REVISION]``."""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import venv
from fnmatch import fnmatch
from pathlib import Path

from tests.oracle.comparing import answer_differences, end_probability, map_differences
from tests.oracle.jobs import OTHER_DRAWS, QUESTIONS, WAS_WRONG, Job, jobs, to_json

OLD = "before-one-tracer"
"""The build that is compared with unless another is named."""

ROOT = Path(__file__).parents[2]
RUNNING = Path(__file__).with_name("running.py")
LEAST_PROBABILITY = 1e-3


def interpreter_of(revision: str, home: Path) -> Path:
    """Interpreter of an environment with the given revision installed; made if there is none."""
    sha = subprocess.check_output(
        ["git", "-C", str(ROOT), "rev-parse", f"{revision}^{{commit}}"], text=True
    ).strip()
    place = home / sha[:12]
    python = place / "env" / "bin" / "python"
    if not (place / "installed").exists():
        sources = place / "sources"
        if not sources.exists():
            command = ["git", "-C", str(ROOT), "worktree", "add", "--detach", str(sources), sha]
            subprocess.run(command, check=True)
        venv.create(place / "env", with_pip=True, clear=True)
        subprocess.run(
            [python, "-m", "pip", "install", "-q", "-e", f"{sources}[mesh,fit]"], check=True
        )
        (place / "installed").touch()
    return python


def run_all(python: Path, folder: Path, todo: list[tuple[str, list[str]]], name: str) -> dict:  # type: ignore[type-arg]
    """Answers of one build, by command."""
    commands, answers = folder / f"{name}.commands.json", folder / f"{name}.answers.json"
    to_json(commands, todo)
    environment = {key: value for key, value in os.environ.items() if key != "NUMBA_CACHE_DIR"}
    if python == Path(sys.executable):
        environment["PYTHONPATH"] = str(ROOT)
    else:
        environment.pop("PYTHONPATH", None)
    command = [str(python), str(RUNNING), str(commands), str(answers)]
    subprocess.run(command, check=True, cwd=folder, env=environment)
    return dict(json.loads(answers.read_text()))


def run_both(chosen: list[Job], old: str, home: Path) -> dict[str, dict]:  # type: ignore[type-arg]
    """Answers of both builds to all jobs, and of this one to questions to the maps of both."""
    folder = home / "work"
    builds = {"old": interpreter_of(old, home), "new": Path(sys.executable)}
    answers = {}
    for which, python in builds.items():
        todo = []
        for job in chosen:
            output = folder / which / f"{job.name}.raymap"
            todo.append((job.name, job.for_build(which, output)))
            for question, words in QUESTIONS.items() if job.map else ():
                ask = [str(output) if word == "MAP" else word for word in words]
                todo.append((f"{job.name}?{question}", ask))
                if which == "new":
                    earlier = str(folder / "old" / f"{job.name}.raymap")
                    again = [earlier if word == "MAP" else word for word in words]
                    todo.append((f"{job.name}?old?{question}", again))
        answers[which] = run_all(python, folder, todo, which)
    return answers


def verdict(job: Job, old: dict, new: dict, folder: Path) -> tuple[bool, str]:  # type: ignore[type-arg]
    """Whether the builds agree on a job as its class demands, and how."""
    found = answer_differences(old[job.name], new[job.name])
    if not job.map or old[job.name]["status"] != 0:
        return not found, "; ".join(found) or "the same answer"
    maps = [folder / which / f"{job.name}.raymap" for which in ("old", "new")]
    differences = map_differences(*maps)
    if job.name in WAS_WRONG:
        columns = [item for item in differences if not item.startswith("results of")]
        same = "columns have equal bits" if not columns else "; ".join(columns)
        return not columns, f"was wrong; right: {WAS_WRONG[job.name]}; {same}"
    if differences and (job.kind == "B" or job.name in OTHER_DRAWS):
        p = end_probability(*maps)
        how = OTHER_DRAWS.get(job.name, f"{len(differences)} columns: {differences[0]}")
        return p > LEAST_PROBABILITY, f"fluxes of ends: p = {p:.3g}; {how}"
    for question in QUESTIONS:
        key = f"{job.name}?{question}"
        found += [f"{question}: {item}" for item in answer_differences(old[key], new[key])]
    key = f"{job.name}?old"
    for question in QUESTIONS:
        asked = answer_differences(old[f"{job.name}?{question}"], new[f"{key}?{question}"])
        found += [f"old map, {question}: {item}" for item in asked]
    found = differences + found
    return not found, "; ".join(found[:4]) or "equal bits"


def main() -> int:
    """Print a row per job; 1 where the builds disagree."""
    parser = argparse.ArgumentParser(prog="python -m tests.oracle", description=__doc__)
    parser.add_argument("jobs", nargs="*", help="names or patterns; all unless given")
    parser.add_argument("--old", default=OLD, help="revision to compare with (%(default)s)")
    parser.add_argument("--rays", type=int, default=20_000, help="of each map (%(default)s)")
    parser.add_argument(
        "--again", action="store_true", help="compare what was written before; run nothing"
    )
    parser.add_argument("--home", type=Path, default=Path.home() / ".cache" / "raymap-oracle")
    asked = parser.parse_args()
    folder: Path = asked.home / "work"
    for which in ("old", "new"):
        (folder / which).mkdir(parents=True, exist_ok=True)
        for stale in () if asked.again else (folder / which).glob("*.raymap"):
            stale.unlink()
    chosen = [
        job
        for job in jobs(folder, asked.rays)
        if not asked.jobs or any(fnmatch(job.name, pattern) for pattern in asked.jobs)
    ]
    if asked.again:
        answers = {
            which: dict(json.loads((folder / f"{which}.answers.json").read_text()))
            for which in ("old", "new")
        }
    else:
        answers = run_both(chosen, asked.old, asked.home)
    failed = 0
    for job in chosen:
        good, how = verdict(job, answers["old"], answers["new"], folder)
        failed += not good
        print(f"{'ok  ' if good else 'FAIL'} {job.kind} {job.name}: {how}")
    print(f"{len(chosen)} jobs, {failed} disagree")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
