"""`python -m studies` and `onboard study`: the claims of a paper, measured."""

import argparse
import pkgutil
import re
import sys
from collections.abc import Mapping
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final, get_args

from rich.markdown import Markdown
from rich.table import Column, Table

import studies
from onboard import UserError, with_extra
from onboard.analysis.parallel.cluster import ClusterError
from onboard.commands.computers import computers
from onboard.terminal.console import Console
from onboard.terminal.files import check_targets, make_folder, write_json
from onboard.terminal.progress import progress_bar
from studies.report.findings import Verdict
from studies.together import run_all, run_study

FIGURE_FILE: Final = re.compile(r"figure-(\d\d)(?:(-|-and-)(\d\d))?-")


def main(arguments: argparse.Namespace) -> int:
    """Measure one study, or all. Raises UserError."""
    a = arguments
    if a.all and (a.cluster or a.rows):
        raise UserError("study: --cluster and --rows go with one name, not with --all")
    if a.all and a.name is None:
        for option, value in (("--first-seed", a.first_seed), ("--jobs", a.jobs), ("--figure", a.figure)):
            if value is not None:
                raise UserError(
                    f"study: {option} goes with one name, not with --all, whose studies have their own"
                )
        if a.cases or a.departures or a.leaders_from:
            raise UserError("study: --cases, --departures and --leaders-from go with one name, not with --all")
        return all_studies(seeds=a.seeds, out=a.out, json_file=a.json)
    if a.all or a.name is None:
        raise UserError(f"study: give --all, or one name of: {', '.join(study_names())}")
    chosen = {"seeds": a.seeds, "first_seed": a.first_seed}
    given: dict[str, Any] = {k: v for k, v in chosen.items() if v is not None}
    given["jobs"] = computers(a.jobs, a.cluster, a.rows)
    if a.cases or a.departures or a.leaders_from:
        given |= _part(a)
    if a.figure is not None:
        if a.json is not None:
            raise UserError("study: --json goes with a whole study, not with --figure")
        return one_figure(a.name, a.figure, given, out=a.out)
    return one_study(a.name, given, out=a.out, json_file=a.json)


def _part(a: argparse.Namespace) -> dict[str, Any]:
    """The arguments of a study for a part of it. Raises UserError."""
    options = getattr(import_module(_module(a.name)), "options", None) if a.name in study_names() else None
    if options is None:
        raise UserError("study: --cases, --departures and --leaders-from go with encounters")
    try:
        found: dict[str, Any] = options(a.seeds, a.cases, departures=a.departures, leaders_from=a.leaders_from)
    except ValueError as error:
        raise UserError(f"study: {'--leaders-from' if a.leaders_from else '--cases'}: {error}") from error
    for why in found.pop("refused", ()):
        print(f"not flown: {why}", file=sys.stderr)
    return found


def one_study(name: str, given: Mapping[str, Any], *, out: Path, json_file: Path | None) -> int:
    """Run `onboard study NAME`, and write figures, report and numbers into a folder of `out`.

    `given` has seeds and first_seed, by default those of the study, and jobs, where it computes.
    """
    _prepare(name, out)
    check_targets(json_file)
    result = _measure(name, given, out)
    Console().print(Markdown((out / name / "report.md").read_text(encoding="utf-8")))
    print(f"written: {out / name}/report.md, result.json and figures")
    if json_file is not None:
        write_json(json_file, result)
    return 0


def one_figure(name: str, number: int, given: Mapping[str, Any], *, out: Path) -> int:
    """Run `onboard study NAME --figure K`: draw the paper's figure K alone.

    It shows the first seed, or `given` seeds if it is over several runs.
    """
    _prepare(name, out)
    with TemporaryDirectory(dir=out) as folder:
        drawn = _drawn(name, given, Path(folder))
        numbered = {k: file for file in drawn for k in paper_figures(file.name)}
        if number not in numbered:
            there_are = ", ".join(map(str, sorted(numbered))) or "none"
            raise UserError(f"study: {name} draws no figure {number} of its paper; there are: {there_are}")
        target = out / name / numbered[number].name
        numbered[number].replace(target)
    print(f"written: {target}")
    return 0


def paper_figures(file_name: str) -> range | tuple[int, ...]:
    """Return the numbers of the paper's figures that a file redraws.

    figure-02-05-NAME is the second to the fifth, figure-01-and-11-NAME these two.
    """
    found = FIGURE_FILE.match(file_name)
    if found is None:
        return ()
    first, link, last = int(found[1]), found[2], int(found[3] or found[1])
    return (first, last) if link == "-and-" else range(first, last + 1)


def _drawn(name: str, given: Mapping[str, Any], folder: Path) -> list[Path]:
    """A study's figures, drawn in a folder; where it can, the paper's alone."""
    draw_paper = getattr(import_module(_module(name)), "draw_paper", None)
    if draw_paper is not None and "seeds" not in given:
        return [folder / file for file in draw_paper(given.get("first_seed", 1), folder)]
    return [folder / name / file for file in _measure(name, {"seeds": 1, **given}, folder)["figures"]]


def all_studies(*, seeds: int | None, out: Path, json_file: Path | None) -> int:
    """`onboard study --all`: every study, two at a time; the JSON has their numbers by name."""
    known = study_names()
    _require_figures()
    for name in known:
        make_folder(out / name)
    check_targets(json_file)
    results = _measure_all(known, seeds, out)
    name_column = Column("study", no_wrap=True)
    table = Table(
        name_column, "claims: hold", "only if", "do not", "not decided", "agree with reference", box=None
    )
    for name, result in results.items():
        verdicts = [claim["verdict"] for claim in result.get("claims", ())]
        held = [str(verdicts.count(verdict)) for verdict in get_args(Verdict)]
        compared = [c["agrees"] for c in result.get("checks", result.get("comparisons", ()))]
        table.add_row(name, *held, f"{sum(compared)} of {len(compared)}")
    Console().print(table)
    print(f"written: report.md, result.json and figures in each folder of {out}")
    if json_file is not None:
        write_json(json_file, results)
    return 0


def study_names() -> list[str]:
    """Every study there is: the folders of studies."""
    folders = (m.name for m in pkgutil.iter_modules(studies.__path__) if m.ispkg)
    return sorted(name.replace("_", "-") for name in folders if find_spec(f"{studies.__name__}.{name}.study"))


def _prepare(name: str, out: Path) -> None:
    """Before anything is flown. Raises UserError: no such study, nowhere to write, no matplotlib."""
    known = study_names()
    if name not in known:
        raise UserError(f"no study named {name!r}; there are: {', '.join(known)}")
    _require_figures()
    make_folder(out / name)


def _measure(name: str, given: Mapping[str, Any], out: Path) -> dict[str, Any]:
    with progress_bar(Console(stderr=True)) as bar:
        task = bar.add_task(_title(name), total=None)
        try:
            return run_study(name, given, out, lambda done, total: bar.update(task, completed=done, total=total))
        except ClusterError as error:
            raise UserError(str(error)) from error


def _measure_all(names: list[str], seeds: int | None, out: Path) -> dict[str, dict[str, Any]]:
    with progress_bar(Console(stderr=True)) as bar:
        tasks = {name: bar.add_task(_title(name), total=None) for name in names}
        return run_all(
            names, seeds, out, lambda name, done, total: bar.update(tasks[name], completed=done, total=total)
        )


def _title(name: str) -> str:
    title: str = import_module(_module(name)).TITLE
    return title


def _module(name: str) -> str:
    return f"{studies.__name__}.{name.replace('-', '_')}.study"


def _require_figures() -> None:
    """Before anything is compiled or flown. Raises UserError where figures cannot be drawn."""
    if find_spec("matplotlib") is None:
        raise UserError(f"figures need matplotlib: {with_extra('study')}")
