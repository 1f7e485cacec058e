"""Builds mutants drawn at random and runs the unit suites that execute their lines.

The libraries are shared and count the lines that are executed. A mutant costs one object, one library that stands before the
right one when suites are loaded, and the suites that reach its line: those of its module first, then the fastest. The first that
fails catches it. As many mutants run at once as there are processors. Where the change shows in the module file, as that of a
public constant, all that use the module are built again, one such mutant at a time.
"""

from __future__ import annotations

import gzip
import hashlib
import json
import math
import os
import re
import shlex
import shutil
import signal
import struct
import subprocess
import tempfile
import threading
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from mutant_parts.drawing import Draw, draws
from mutant_parts.tree import ROOT, SCRATCH, SOURCE, copy_tree

BUILD = SCRATCH / "random"
REACH = BUILD / "reach.json"
COUNTERS = BUILD / "counters"
ALONE = BUILD / "mutant"  # object and library of each mutant
NO_COUNTERS = Path(os.devnull) / "none"  # where none can be written
CONFIGURE = (
    *("-G", "Ninja", "-DBUILD_SHARED_LIBS=ON", "-DHB_COVERAGE=ON", "-DCMAKE_BUILD_TYPE=None", "-DCMAKE_LINK_DEPENDS_NO_SHARED=ON"),
    "-DCMAKE_EXPORT_COMPILE_COMMANDS=ON",
    "-DCMAKE_Fortran_FLAGS=-O1 -fcheck=bounds -ffpe-trap=invalid,zero,overflow",
    *(["-DCMAKE_SHARED_LINKER_FLAGS=-fuse-ld=gold"] if shutil.which("ld.gold") else []),
)
SLOWER, PATIENCE = 3, 3  # a suite may take so many times its processor time without a mutant, and so many seconds more
WAITING = 20  # wall time for a second of that: other programs run beside
LONGEST = 40.0  # [s] of the processor: suites that take longer are left out
ENOUGH = 45.0  # [s] of the processor without a mutant, of the suites that are run for one
CAUGHT, SURVIVED, TOO_LONG, NOT_BUILT = "caught", "survived", "too long", "does not build"
RUNNING: set[int] = set()  # suites, each the leader of a group
is_over = threading.Event()  # ended by a signal


@dataclass(frozen=True)
class Suite:
    """A unit suite as ctest runs it."""

    name: str
    command: list[str]
    environment: dict[str, str]


@dataclass(frozen=True)
class Verdict:
    draw: Draw
    verdict: str
    suite: str  # that caught it
    reached_by: int  # suites
    seconds: float


class Failure(Exception):
    """The source does not build, or a suite fails, without a mutant."""


def assess(count: int, seed: int, jobs: int, only: str, note) -> list[Verdict]:
    """So many mutants of some modules that build, `jobs` at once, fewer where it is interrupted; `note` is called with each
    verdict."""
    suites = prepare(jobs)
    reach = reach_of(suites, jobs)
    verdicts: list[Verdict] = []
    drawn = enumerate(draws(SOURCE, 10 * count, seed, only))

    def missing() -> int:
        return count - sum(verdict.verdict != NOT_BUILT for verdict in verdicts)

    def one(numbered: tuple[int, Draw]) -> tuple[Draw, Verdict | None]:
        return numbered[1], verdict_alone(*numbered, suites, reach)

    with ThreadPoolExecutor(jobs) as pool:
        try:
            while missing() > 0 and (batch := list(islice(drawn, missing()))):
                in_tree = []
                for draw, verdict in pool.map(one, batch):
                    if verdict is None:
                        in_tree.append(draw)
                        continue
                    verdicts.append(verdict)
                    note(verdict)
                for draw in in_tree:
                    verdicts.append(verdict_in_tree(draw, suites, reach))
                    note(verdicts[-1])
                if in_tree:
                    build(jobs)
        except KeyboardInterrupt:  # what was found so far
            is_over.set()
            for group in list(RUNNING):
                end_group(group)
            pool.shutdown(cancel_futures=True)
    return verdicts


def prepare(jobs: int) -> dict[str, Suite]:
    """Builds the unit suites of the tree as it is."""
    copy_tree()
    run(["cmake", "-S", str(SOURCE), "-B", str(BUILD), *CONFIGURE, *shlex.split(os.environ.get("CMAKE_ARGUMENTS", ""))])
    build(jobs)
    shutil.rmtree(ALONE, ignore_errors=True)
    return unit_suites()


def build(jobs: int) -> None:
    run(["cmake", "--build", str(BUILD), "--parallel", str(jobs), "--target", "unit_suites"])


def end_group(group: int) -> None:
    try:
        os.killpg(group, signal.SIGKILL)
    except ProcessLookupError:  # just over
        pass


def run(words: list[str]) -> str:
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise Failure("\n".join((done.stdout + done.stderr).splitlines()[-20:]))
    return done.stdout


def unit_suites() -> dict[str, Suite]:
    found = {}
    for test in json.loads(run(["ctest", "--test-dir", str(BUILD), "-L", "unit", "-LE", "long", "--show-only=json-v1"]))["tests"]:
        values = {item["name"]: item["value"] for item in test["properties"]}
        environment = dict(word.split("=", 1) for word in values.get("ENVIRONMENT", []))
        if "command" in test and test["name"].startswith("test_"):  # not what configures or tests the runner
            found[test["name"]] = Suite(test["name"], test["command"], environment)
    return found


def outcome_of(suite: Suite, seconds: float, counters: Path, libraries: str = "") -> tuple[str, float]:
    """Whether a suite passes within so much processor time, and how much it takes."""
    environment = {**os.environ, **suite.environment, "GCOV_PREFIX": str(counters)}
    environment["LD_LIBRARY_PATH"] = ":".join(filter(None, [libraries, os.environ.get("LD_LIBRARY_PATH")]))
    limit = math.ceil(seconds)
    with tempfile.TemporaryDirectory(prefix="mutant-") as folder, subprocess.Popen(  # suites write files of the same names
        ["sh", "-c", f'ulimit -t {limit}; exec "$@"', "sh", *suite.command],
        cwd=folder,
        env=environment,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    ) as running:
        too_long = threading.Event()

        def end() -> None:
            too_long.set()
            end_group(running.pid)

        RUNNING.add(running.pid)
        timer = threading.Timer(0.0 if is_over.is_set() else WAITING * limit, end)
        timer.start()
        _, status, usage = os.wait4(running.pid, 0)
        timer.cancel()
        RUNNING.discard(running.pid)
        running.returncode = os.waitstatus_to_exitcode(status)
    ended = -running.returncode in (signal.SIGXCPU, signal.SIGKILL) or too_long.is_set()
    outcome = "passed" if running.returncode == 0 else TOO_LONG if ended else CAUGHT
    return outcome, usage.ru_utime + usage.ru_stime


def reach_of(suites: dict[str, Suite], jobs: int) -> dict:
    """For each suite its seconds and, of each source, the lines that it executes and all that count; known ones are used again."""
    known = json.loads(REACH.read_text(encoding="utf-8")) if REACH.is_file() else {}
    source = stamp_of_source()
    stamp = {name: stamp_of(suite, source) for name, suite in suites.items()}
    reach = {name: known[name] for name in suites if name in known and known[name]["stamp"] == stamp[name]}
    reach = {name: found for name, found in reach.items() if found["lines"] or found["seconds"] >= LONGEST - 1}

    def one(name: str) -> dict:
        counters = COUNTERS / name
        shutil.rmtree(counters, ignore_errors=True)
        outcome, seconds = outcome_of(suites[name], LONGEST, counters)
        if outcome == CAUGHT and seconds < LONGEST:
            raise Failure(f"{name} fails without a mutant")
        found = {"stamp": stamp[name], "seconds": seconds, "lines": executed_lines(counters) if outcome == "passed" else {}}
        shutil.rmtree(counters, ignore_errors=True)
        return found

    new = [name for name in suites if name not in reach]
    with ThreadPoolExecutor(jobs) as pool:
        for name, found in zip(new, pool.map(one, new)):
            reach[name] = found
            REACH.write_text(json.dumps(reach), encoding="utf-8")
    return reach


def stamp_of(suite: Suite, source: str) -> str:
    """Changes with what a suite runs."""
    return source + "".join(hashlib.sha256(path.read_bytes()).hexdigest() for path in (ROOT / "tests").rglob(f"{suite.name}.pf"))


def stamp_of_source() -> str:
    return hashlib.sha256(b"".join(path.read_bytes() for path in sorted((SOURCE / "src").rglob("*.[fch]*")))).hexdigest()


def executed_lines(counters: Path) -> dict[str, dict[str, list[int]]]:
    """Of each source the lines with counters, and those that were executed."""
    in_suite = "/__/src/"  # compiled into a suite
    of_source = re.compile("/src/CMakeFiles/|" + in_suite)
    data = [path for path in counters.rglob("*.gcda") if of_source.search(str(path)) and has_counted(path.read_bytes())]
    for path in data:  # gcov reads the notes of the compiler from the same folder
        notes = Path("/", path.relative_to(counters)).with_suffix(".gcno")
        path.with_suffix(".gcno").symlink_to(notes)
    work = counters / "gcov"
    work.mkdir(parents=True, exist_ok=True)
    subprocess.run(["gcov", "-i", *map(str, data)], cwd=work, capture_output=True, check=False)
    lines: dict[str, dict[str, set[int]]] = {}
    for path in work.glob("*.gcov.json.gz"):
        content = json.loads(gzip.open(path).read())
        for file in content["files"]:
            if str(SOURCE / "src") in file["file"]:
                found = lines.setdefault(str(Path(file["file"]).relative_to(SOURCE)), {"all": set(), "executed": set()})
                found["all"] |= {line["line_number"] for line in file["lines"]}
                counts_all = in_suite in content["data_file"]  # such a suite starts processes, whose counts are lost
                found["executed"] |= {line["line_number"] for line in file["lines"] if line["count"] > 0 or counts_all}
    return {name: {kind: sorted(numbers) for kind, numbers in found.items()} for name, found in lines.items()}


def has_counted(data: bytes) -> bool:
    """Whether counters of a .gcda of GCC 12 are not all zero: those that are have records of negative length without values."""
    at = 16
    while at + 8 <= len(data):
        tag, length = struct.unpack_from("<Ii", data, at)
        if tag & 0xFFFF0000 == 0x01A10000 and length > 0:
            return True
        at += 8 + max(length, 0)
    return False


def reaching(draw: Draw, reach: dict) -> list[str]:
    """Suites that execute a line of the statement, or the one before it that has a counter; that of its module first, then
    those of whose work the source is the largest part for their time.

    Values of declarations have none: all suites that execute anything of the source, or, where it has nothing but declarations,
    of a source that uses it."""
    text = (SOURCE / draw.file).read_text(encoding="utf-8").split("\n")
    if not any(draw.file in known["lines"] for known in reach.values()):
        return reaching_users(draw, reach)
    declares = "::" in text[draw.line - 1]
    statement = lines_of_statement(text, draw.line)
    found = []
    for name, known in reach.items():
        lines = known["lines"].get(draw.file)
        if lines is None or known["seconds"] > LONGEST:
            continue
        before = [number for number in lines["all"] if number <= draw.line]
        here = statement & set(lines["all"]) or set(before[-1:])  # gcov counts some statements at one of their lines alone
        if lines["executed"] if declares or not before else here & set(lines["executed"]):
            found.append(name)
    module = Path(draw.file).stem

    def order(name: str) -> tuple[bool, float]:
        lines = {source: len(known["executed"]) for source, known in reach[name]["lines"].items()}
        return name != f"test_{module}", -lines[draw.file] / sum(lines.values()) / (reach[name]["seconds"] + 0.5)

    return sorted(found, key=order)


def reaching_users(draw: Draw, reach: dict) -> list[str]:
    """Suites that execute anything of a source that uses the module, the fastest first."""
    use = re.compile(rf"^ *use {Path(draw.file).stem}\b", re.MULTILINE)
    users = {str(path.relative_to(SOURCE)) for path in SOURCE.rglob("src/**/*.f90") if use.search(path.read_text(encoding="utf-8"))}
    found = [name for name, known in reach.items() if known["seconds"] <= LONGEST and users & set(known["lines"])]
    return sorted(found, key=lambda name: (name != f"test_{Path(draw.file).stem}", reach[name]["seconds"]))


def lines_of_statement(text: list[str], line: int) -> set[int]:
    """Numbers, from 1, of the lines that are one statement with a line."""
    first = last = line
    while first > 1 and text[first - 2].split("!")[0].rstrip().endswith("&"):
        first -= 1
    while last < len(text) and text[last - 1].split("!")[0].rstrip().endswith("&"):
        last += 1
    return set(range(first, last + 1))


def verdict_alone(number: int, draw: Draw, suites: dict[str, Suite], reach: dict) -> Verdict | None:
    """That of a mutant whose object alone is built; none where that does not do."""
    started = time.monotonic()
    folder = ALONE / str(number)
    try:
        is_built, is_alone = build_alone(draw.file, draw.applied_to((SOURCE / draw.file).read_text(encoding="utf-8")), folder)
        if not is_built:
            return Verdict(draw, NOT_BUILT, "", 0, time.monotonic() - started)
        return assessed(draw, suites, reach, str(folder), started) if is_alone else None
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def verdict_in_tree(draw: Draw, suites: dict[str, Suite], reach: dict) -> Verdict:
    started = time.monotonic()
    text = draw.applied_to((SOURCE / draw.file).read_text(encoding="utf-8"))
    with built_in_tree(draw.file, text, reaching(draw, reach)) as is_built:
        if not is_built:
            return Verdict(draw, NOT_BUILT, "", 0, time.monotonic() - started)
        return assessed(draw, suites, reach, "", started)


@contextmanager
def built_in_tree(file: str, text: str, names: list[str]):
    """Whether suites can be built with another text of a source; the source is then as it was, not yet what is built of it."""
    target = SOURCE / file
    whole = target.read_text(encoding="utf-8")
    target.write_text(text, encoding="utf-8")
    words = ["cmake", "--build", str(BUILD), "--parallel", "2", "--target", "hb", *names]
    try:
        yield subprocess.run(words, capture_output=True, check=False).returncode == 0
    finally:
        target.write_text(whole, encoding="utf-8")


def assessed(draw: Draw, suites: dict[str, Suite], reach: dict, libraries: str, started: float) -> Verdict:
    """By the suites that reach it, with the libraries of a folder before those of the build."""
    names = reaching(draw, reach)
    spent, word, by = 0.0, SURVIVED, ""
    for name in names:
        if spent > ENOUGH or is_over.is_set():
            break
        spent += reach[name]["seconds"]
        outcome, _ = outcome_of(suites[name], SLOWER * reach[name]["seconds"] + PATIENCE, NO_COUNTERS, libraries)
        if outcome != "passed":
            word, by = outcome, name
            break
    return Verdict(draw, word, by, len(names), time.monotonic() - started)


def build_alone(file: str, text: str, folder: Path) -> tuple[bool, bool]:
    """Whether a changed source can be compiled, and whether a library with it serves what was built without it."""
    folder.mkdir(parents=True)
    source, thing = folder / Path(file).name, folder / "changed.o"
    source.write_text(text, encoding="utf-8")
    commands = json.loads((BUILD / "compile_commands.json").read_text(encoding="utf-8"))
    command = next((entry["command"] for entry in commands if entry["file"] == str(SOURCE / file)), None)
    if command is None:  # of another configuration
        return False, False
    words = shlex.split(command)
    place = words[words.index("-o") + 1]
    changes = {place: str(thing), str(SOURCE / file): str(source), "-Jsrc/modules": f"-J{folder}", "--coverage": "", "-O1": "-O0"}
    words = [changes.get(word, word) for word in words]
    words = [word for word in words if word] + [f"-I{(SOURCE / file).parent}", "-Isrc/modules"]
    if subprocess.run(words, cwd=BUILD, capture_output=True, check=False).returncode != 0:
        return False, False
    for module in folder.glob("*.mod"):
        if meaning(module) != meaning(BUILD / "src" / "modules" / module.name):
            return True, False
    library = "lib" + place.split("/CMakeFiles/")[1].split(".dir/")[0].removeprefix("lib") + ".so"
    built = next((path.relative_to(BUILD) for path in BUILD.rglob(library + "*") if not path.is_symlink()), None)
    if built is None:  # of a program, not of a library
        return True, False
    link = run(["ninja", "-C", str(BUILD), "-t", "commands", str(built)]).splitlines()[-1]
    loaded = re.search(r"-soname,(\S+)", link)[1]
    link = link.replace(f" {place} ", f" {thing} ").replace(f"-o {built} ", f"-o {folder / loaded} ")
    return True, subprocess.run(link, shell=True, cwd=BUILD, capture_output=True, check=False).returncode == 0


def meaning(module: Path) -> bytes:
    """A module file of gfortran without its first line, which names the source."""
    return gzip.open(module).read().split(b"\n", 1)[1]


def line_of(verdict: Verdict) -> str:
    """One line of a list: what was changed and what became of it."""
    draw = verdict.draw
    text = (SOURCE / draw.file).read_text(encoding="utf-8").split("\n")[draw.line - 1]
    changed = (text[: draw.column] + "«" + draw.old + "→" + draw.new + "»" + text[draw.column + len(draw.old) :]).strip()
    by = f" by {verdict.suite}" if verdict.suite else ""
    if verdict.verdict == SURVIVED:
        by = f", {verdict.reached_by} suites execute it"
    return f"{draw.file.removeprefix('src/')}:{draw.line} ({draw.kind}): `{changed}`: {verdict.verdict}{by}"


def table_of(verdicts: list[Verdict]) -> str:
    """Numbers by layer and by kind of change, and the survivors."""
    counted = [verdict for verdict in verdicts if verdict.verdict != NOT_BUILT]
    caught = [verdict for verdict in counted if verdict.verdict in (CAUGHT, TOO_LONG)]
    rows = []
    for heading, name_of in (("layer", lambda draw: draw.file.split("/")[1]), ("kind of change", lambda draw: draw.kind)):
        drawn, seen = (Counter(name_of(verdict.draw) for verdict in some) for some in (counted, caught))
        rows += [f"| {heading} | drawn | caught |", "|---|---|---|"]
        rows += [f"| {name} | {drawn[name]} | {seen[name]} |" for name in sorted(drawn)]
        rows += [f"| all | {len(counted)} | {len(caught)} |", ""]
    late = sum(verdict.verdict == TOO_LONG for verdict in counted)
    words = f"{len(verdicts) - len(counted)} more did not build and do not count; {late} of those caught ran too long."
    survivors = ["- " + line_of(verdict) for verdict in counted if verdict.verdict == SURVIVED]
    return "\n".join([*rows, words, "", "Survivors:", "", *survivors])
