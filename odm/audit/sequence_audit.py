"""Audit what a planner remembers: many sequences of frames, judged leg by leg."""

import multiprocessing
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from odm.audit.sequence_judge import Judge, Verdict
from odm.audit.sequences import KINDS, Sequence, Step, reuse_certificate
from odm.cell_map.cell_map import CellMap, load_map
from odm.processes import in_processes
from roadmap.builds.chunks import Progress
from roadmap.errors import BadInput

LENGTH = 500  # steps of a sequence
EXACT_EVERY = 50  # one step in so many is measured with exact solids in any case
LISTED = 20  # faults that a report tells in words
ANSWERED = 0.5  # share of the steps that must be answered with a path
SABOTAGE = "certificate"
_SUMMED = (
    "steps", "answered", "legs", "exact", "near", "wrong", "unproved", "ways_out",
)  # fmt: skip


@dataclass
class SequenceReport:
    """What an audit by sequences found.

    Attributes:
        steps: Frames that were asked.
        answered: Those answered with a path.
        legs: Legs of these paths, each judged by a fresh planner.
        exact: Answers that were measured with exact solids.
        near: Answers that would fail with 5 mm more of clearance.
        wrong: Answers with a fault.
        unproved: Legs that a fresh planner refuses as a whole, but at no place.
        ways_out: Ways out of frames that hold, all judged and measured exactly.
        kinds: Answers with a path, and how many of them were measured exactly, of each
            kind of `odm.audit.sequences.KINDS`; what is 0 was not attacked.
        smallest: Smallest exact distance [m] less what is to be kept; inf: none.
        first_faults: (seed, step, fault) of the first faults.
        seed, seconds, sabotage, complete: How it was run; not complete if interrupted.
    """

    steps: int = 0
    answered: int = 0
    legs: int = 0
    exact: int = 0
    near: int = 0
    wrong: int = 0
    unproved: int = 0
    ways_out: int = 0
    kinds: dict[str, tuple[int, int]] = field(
        default_factory=lambda: dict.fromkeys(KINDS, (0, 0))
    )
    smallest: float = np.inf
    first_faults: list[tuple[int, int, str]] = field(default_factory=list)
    seed: int = 0
    seconds: float = 0.0
    sabotage: str | None = None
    complete: bool = True

    @property
    def answered_share(self) -> float:
        """Share of the steps that were answered with a path."""
        return self.answered / max(1, self.steps)

    @property
    def passed(self) -> bool:
        """True if no answer has a fault, and enough were answered to show anything."""
        return self.wrong == 0 and self.complete and self.answered_share >= ANSWERED

    def add(self, other: "SequenceReport") -> None:
        """Add another part."""
        for name in _SUMMED:
            setattr(self, name, getattr(self, name) + getattr(other, name))
        for name, counts in other.kinds.items():
            self._count(name, *counts)
        self.smallest = min(self.smallest, other.smallest)
        self.first_faults = (self.first_faults + other.first_faults)[:LISTED]

    def count(self, step: Step, verdict: Verdict) -> None:
        """Count an answer with a path."""
        self.answered += 1
        self.legs += len(step.answer.path) - 1
        self.exact += verdict.exact
        self.near += verdict.near
        self.unproved += verdict.unproved
        for name in step.kinds:
            self._count(name, 1, int(verdict.exact))

    def _count(self, name: str, answers: int, exact: int) -> None:
        before = self.kinds[name]
        self.kinds[name] = before[0] + answers, before[1] + exact

    def as_dict(self) -> dict:
        """Return everything as plain JSON data."""
        plain = {name: getattr(self, name) for name in self.__dataclass_fields__}
        smallest = self.smallest if np.isfinite(self.smallest) else None
        shares = {"answered_share": self.answered_share, "passed": self.passed}
        return plain | {"smallest": smallest} | shares

    def __str__(self) -> str:
        verdict = "passed" if self.passed else "FAILED"
        if not self.complete and not self.wrong:
            verdict = "was interrupted"
        return (
            f"audit by sequences {verdict}: {self.wrong} false answers in "
            f"{self.steps:,} steps, {self.answered_share:.0%} answered with a path, "
            f"{self.legs:,} legs judged, {self.exact:,} answers measured exactly, "
            f"{self.near:,} of all near to what they must keep, {self.ways_out:,} ways "
            "out judged"
        )


def audit_sequences(
    map_dir: str | Path,
    *,
    steps: int = 10_000,
    seed: int = 0,
    processes: int = 0,
    sabotage: str | None = None,
    progress: Progress | None = None,
) -> SequenceReport:
    """Attack planners on a map by random sequences; see `odm.audit.sequences`.

    Args:
        map_dir: Folder of the map.
        steps: Frames in all; a planner lives for 500 of them.
        seed: Same seed, same sequences, for any number of processes.
        processes: Sequences at a time; 0 means one per core.
        sabotage: "certificate": a certificate is used for a shifted motion, which the
            audit must find; it ends when it has.
        progress: Called with (stage, done, total).

    Returns:
        The report; after Ctrl-C that of the sequences done so far, not `complete`.

    Raises:
        BadInput: No such sabotage.
        BadMap: No map there.
    """
    if sabotage not in (None, SABOTAGE):
        raise BadInput(
            f"sabotage {sabotage!r} is unknown to sequences; the only one is "
            f"{SABOTAGE!r}"
        )
    begun = time.perf_counter()
    tell = progress or (lambda stage, done, total: None)
    sizes = [min(LENGTH, steps - at) for at in range(0, steps, LENGTH)]
    jobs = [(seed * 1_000_000 + k, n, sabotage) for k, n in enumerate(sizes)]
    report = SequenceReport(seed=seed, sabotage=sabotage)
    processes = min(processes or multiprocessing.cpu_count(), len(jobs))
    tell("sequences", 0, steps)
    try:
        for part in _parts(map_dir, jobs, processes):
            report.add(part)
            tell("sequences", report.steps, steps)
            if sabotage and report.wrong:
                break
    except KeyboardInterrupt:
        report.complete = False
    report.seconds = time.perf_counter() - begun
    return report


def _parts(
    map_dir: str | Path, jobs: list[tuple], processes: int
) -> Iterator[SequenceReport]:
    if processes <= 1:
        _prepare(map_dir)
        yield from map(_run, jobs)
        return
    load_map(map_dir)  # is refused here, in one sentence
    with in_processes(processes, _run, jobs, _prepare, (map_dir,)) as parts:
        yield from parts


_shared: dict[str, object] = {}  # of a process: the map, and its judge


def _prepare(map_dir: str | Path) -> None:
    cell_map = load_map(map_dir)
    _shared.update(map=cell_map, judge=Judge(cell_map))


def _run(job: tuple[int, int, str | None]) -> SequenceReport:
    seed, steps, sabotage = job
    return run_sequence(_shared["map"], _shared["judge"], seed, steps, sabotage)


def run_sequence(
    cell_map: CellMap, judge: Judge, seed: int, steps: int, sabotage: str | None = None
) -> SequenceReport:
    """Run one sequence and sum up what was found."""
    tamper = reuse_certificate if sabotage else None
    report = SequenceReport(seed=seed, sabotage=sabotage)
    sequence = Sequence(cell_map, seed, judge, tamper)
    played = sequence.run(steps, EXACT_EVERY)
    for k in range(steps):
        try:
            step = next(played)
        except Exception as error:  # a crash is a fault like any other
            report.wrong += 1
            report.first_faults.append(
                (seed, k, f"raised {type(error).__name__}: {error}")
            )
            break
        report.steps += 1
        if step.verdict is not None:
            report.count(step, step.verdict)
        report.ways_out += step.way_out is not None
        verdict = step.verdict or step.way_out
        if verdict is None:
            continue
        report.wrong += bool(verdict.wrong)
        report.smallest = min(report.smallest, verdict.gap)
        report.first_faults += [(seed, k, fault) for fault in verdict.wrong]
    report.first_faults = report.first_faults[:LISTED]
    return report
