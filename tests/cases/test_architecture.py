"""Rules of docs/develop/architecture.md that the compiler does not check: layers, names, outside libraries, procedures that end the
program."""

from __future__ import annotations

import functools
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SRC = ROOT / "src"

# From the bottom; a module uses its own layer and those before it.
LAYERS = ["base", "extern", "solve", "hypertime", "structure", "laws", "balance", "stability", "motion", "timedomain"]
LAYERS += ["input", "files", "study", "api"]

# Time integration is an independent check of the balance: the modules that these use contain no transforms and solvers of it.
INTEGRATION = ["hb_time_stepping", "hb_integration_difference", "hb_recurrence", "hb_record_tones"]
INTEGRATION_MAY_USE = {"base", "extern", "structure", "laws", "timedomain"}
INTEGRATION_MAY_USE_MODULES = {"hb_birkhoff", "hb_harmonics", "hb_integration_config", "hb_outcome"}  # averages, tuples

INTRINSIC = {"iso_fortran_env", "ieee_arithmetic", "ieee_exceptions", "ieee_features"}

# Routines of MPI, HDF5, FFTW, BLAS and LAPACK, as they would be called without a module.
LIBRARY_CALL = re.compile(
    r"\b((?:mpi|fftw)_\w+|h5[a-z]\w*_f|CVode\w*|SUN\w+|N_V\w+)\s*\("
    r"|\bcall\s+([sdcz](?:ge|gb|gt|po|pb|pt|sy|he|tr)[a-z0-9]{2,4})\s*\(",
    re.IGNORECASE,
)
USE = re.compile(r"^\s*use\b\s*(?:,\s*(intrinsic|non_intrinsic)\s*)?(?:::)?\s*(\w+)", re.IGNORECASE)
MODULE = re.compile(
    r"^\s*(?:sub)?module\s+(?!procedure\b|subroutine\b|function\b)(?:\([^)]*\)\s*)?(\w+)\s*$", re.IGNORECASE
)
STOP = re.compile(r"^\s*(?:\d+\s+)?(?:if\s*\(.*\)\s*)?(?:error\s+)?stop\b(?!\s*[=(%])", re.IGNORECASE)


def sources() -> list[Path]:
    """All Fortran sources of the library; the template of hb_version counts as its module."""
    return sorted([*SRC.rglob("*.f90"), *SRC.rglob("*.F90"), *SRC.rglob("*.f90.in")])


def name_of(path: Path) -> str:
    return path.name.split(".")[0]


def layer_of(path: Path) -> str:
    return path.relative_to(SRC).parts[0]


@functools.cache
def statements(path: Path) -> list[tuple[int, str]]:
    """Statements with their line numbers: without comments and texts, continued lines joined, one per item."""
    result: list[tuple[int, str]] = []
    joined, first = "", 0
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        code = _without_texts(line).rstrip()
        if not joined:
            first = number
        code = code.lstrip()
        joined += code.removeprefix("&") if joined else code
        if joined.endswith("&"):
            joined = joined[:-1]
            continue
        result += [(first, part.strip()) for part in joined.split(";") if part.strip()]
        joined = ""
    return result


def _without_texts(line: str) -> str:
    """Line without its comment, and with empty texts, so that words of a message do not count as code."""
    if '"' not in line and "'" not in line:
        return line.partition("!")[0]
    code, quote = "", ""
    for c in line:
        if quote:
            if c == quote:
                quote = ""
                code += c
        elif c in "\"'":
            quote = c
            code += c
        elif c == "!":
            break
        else:
            code += c
    return code


def used_modules(path: Path) -> list[tuple[int, str]]:
    return [(n, match.group(2).lower()) for n, s in statements(path) if (match := USE.match(s))]


LAYER_OF_MODULE = {name_of(path): layer_of(path) for path in sources()}


def for_all_sources(test):
    """One test of all sources: an item of pytest for each costs more than what is looked at."""

    def of_all():
        problems = []
        for path in sources():
            try:
                test(path)
            except AssertionError as problem:
                problems.append(str(problem).partition("\nassert ")[0])
        assert not problems, "\n".join(problems)

    of_all.__name__, of_all.__doc__ = test.__name__, test.__doc__
    return of_all


@for_all_sources
def test_source_is_in_a_known_layer(path):
    assert layer_of(path) in LAYERS, (
        f"{path.relative_to(ROOT)}: '{layer_of(path)}' is not a layer; add it to LAYERS here, to docs/develop/architecture.md "
        "and to src/CMakeLists.txt"
    )


@for_all_sources
def test_file_is_named_after_its_module(path):
    modules = [match.group(1).lower() for _, s in statements(path) if (match := MODULE.match(s))]
    name = name_of(path)
    assert modules == [name], f"{path.relative_to(ROOT)} holds {modules}, should hold the module {name} alone"


def test_module_names_are_unique():
    """Except for modules that replace an outside library in a build without it."""
    names = [name_of(path) for path in sources() if not path.parent.name.startswith("without_")]
    assert len(names) == len(set(names))


@for_all_sources
def test_no_arrow_goes_up(path):
    height = LAYERS.index(layer_of(path))
    for number, module in used_modules(path):
        if not module.startswith("hb_"):
            continue
        assert module in LAYER_OF_MODULE, f"{path.relative_to(ROOT)}:{number} uses {module}, which is not in src/"
        layer = LAYER_OF_MODULE[module]
        assert LAYERS.index(layer) <= height, (
            f"{path.relative_to(ROOT)}:{number}: {layer_of(path)}/ uses {module} of {layer}/, a layer above its own"
        )


def test_core_has_the_layers_up_to_motion():
    """nhbm::core is made from numbers: it has no input language and nothing above it."""
    lists = (SRC / "CMakeLists.txt").read_text(encoding="utf-8")
    lists = lists.replace("${CMAKE_CURRENT_BINARY_DIR}/", "base/")
    core = re.search(r"target_sources\(hb_core PRIVATE(.*?)\)", lists, re.DOTALL)[1]
    assert set(re.findall(r"^\s+(\w+)/", core, re.MULTILINE)) == set(LAYERS[: LAYERS.index("motion") + 1])
    assert "hb_key_rows" not in core


def test_sources_with_directives_are_compiled_with_threads():
    """Elsewhere directives of OpenMP would be comments; a source without any needs no option."""
    lists = (SRC / "CMakeLists.txt").read_text(encoding="utf-8")
    threaded = re.search(r"if\(HB_THREADS\)(.*?)PROPERTIES COMPILE_OPTIONS", lists, re.DOTALL)[1]
    with_directives = {str(path.relative_to(SRC)) for path in sources() if re.search(r"^ *!\$", path.read_text(), re.MULTILINE)}
    assert set(re.findall(r"^\s+(\w+/\w+\.f90)", threaded, re.MULTILINE)) == with_directives


def test_types_of_a_model_and_its_motion_need_no_solver():
    """gfortran writes into the file of a module all types of all modules that it uses, and reads them for each user."""
    users = {name_of(path): {module for _, module in used_modules(path)} for path in sources()}
    for name in ("hb_model", "hb_motion_result", "hb_level"):
        needed, reached = {name}, set()
        while needed:
            module = needed.pop()
            reached.add(module)
            needed |= users.get(module, set()) - reached
        assert "hb_system" in reached or "hb_estimated_errors" in reached
        assert not reached & {"hb_balance", "hb_solver", "hb_curve", "hb_time_stepping"}, name


def test_integration_is_independent_of_the_balance():
    paths = {name_of(path): path for path in sources()}
    left, seen = list(INTEGRATION), set(INTEGRATION)
    while left:
        name = left.pop()
        for number, module in used_modules(paths[name]):
            if module not in LAYER_OF_MODULE or module in seen:
                continue
            is_free = LAYER_OF_MODULE[module] in INTEGRATION_MAY_USE or module in INTEGRATION_MAY_USE_MODULES
            assert is_free, f"{paths[name].relative_to(ROOT)}:{number}: it uses {module} of {LAYER_OF_MODULE[module]}/"
            seen.add(module)
            left.append(module)


@for_all_sources
def test_outside_libraries_stay_in_extern(path):
    if layer_of(path) == "extern":
        return
    for number, module in used_modules(path):
        is_interface = layer_of(path) == "api" and module == "iso_c_binding"
        allowed = module.startswith("hb_") or module in INTRINSIC or is_interface
        assert allowed, f"{path.relative_to(ROOT)}:{number} uses {module}; outside libraries belong to src/extern/"
    known = _imported(path) | _defined(path)
    for number, statement in statements(path):
        assert not re.match(r"include\b", statement, re.IGNORECASE), f"{path.relative_to(ROOT)}:{number} includes a file"
        for called in ("".join(names) for names in LIBRARY_CALL.findall(statement)):
            assert called.lower() in known, (
                f"{path.relative_to(ROOT)}:{number} calls {called}; outside libraries belong to src/extern/"
            )


def _imported(path: Path) -> set[str]:
    """Names that `use` statements bring in."""
    lists = [s.partition(":")[2] for _, s in statements(path) if USE.match(s)]
    return {word for names in lists for word in re.findall(r"\w+", names.lower())}


def _defined(path: Path) -> set[str]:
    """Procedures that the file defines."""
    pattern = re.compile(r"\b(?:subroutine|function)\s+(\w+)", re.IGNORECASE)
    return {match.group(1).lower() for _, s in statements(path) if (match := pattern.search(s))}


@for_all_sources
def test_nothing_in_the_library_stops_the_program(path):
    """But broken contracts, in builds that check them."""
    if path.name == "hb_assert.f90.in":
        return
    for number, statement in statements(path):
        assert not STOP.match(statement), (
            f"{path.relative_to(ROOT)}:{number}: '{statement}'; return an error, only drivers/ may end the program"
        )


LAYERS_WITHOUT_INPUT = set(LAYERS[: LAYERS.index("input")]) - {"extern"}
INPUT_WORDS = re.compile(r'"[^"]*?(?:\bnhbm [a-z]+|&[a-z_]{3,}\b)[^"]*"')
TEXT = re.compile(r'"([^"]*)"')
OPTION = re.compile(r"\b[a-z]\w*%[a-z]\w*")


@for_all_sources
def test_lower_layers_name_no_commands_and_groups(path):
    """Their messages are those of a library: what to change is named as a component of `options_t`, which is a path of the
    input, too. Advice that names commands and groups is given by the layers above the kernel."""
    if layer_of(path) not in LAYERS_WITHOUT_INPUT:
        return
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        code = line.partition("!>")[0]
        assert not INPUT_WORDS.search(code), f"{path.relative_to(ROOT)}:{number}: {line.strip()}"


def test_messages_of_outcomes_state_facts():
    """What to do is a row of src/advice.txt; errors say themselves what would be right."""
    verbs = "raise|use|try|give|choose|check|set|divide|start|widen|lower|take|add|leave|remove|increase|prescribe"
    do = rf"(?:[;:,] |\.\s+)(?:{verbs})\b"
    advising = []
    for path in [path for path in sources() if layer_of(path) in LAYERS_WITHOUT_INPUT]:
        code = re.sub(r"&\s*\n\s*", "", path.read_text(encoding="utf-8"))
        advising += [f"{path.name}: {line.strip()}" for line in re.findall(r".*message = .*\".*", code)
                     if re.search(do, line) and not re.search(r"\berror%message\b|call ", line)]  # fmt: skip
    for path in sorted((ROOT / "drivers/python/src/nhbm").glob("*.py")):
        advising += [f"{path.name}: {line.strip()}" for line in path.read_text(encoding="utf-8").splitlines()
                     if re.search(r"\bwarn\(f?\"", line)]  # fmt: skip
    assert not advising


def test_options_that_messages_name_exist():
    """`solver%max_work` in a message is a component of `options_t` in Fortran, and a path for `--set`, sweeps and Python."""
    rows = (SRC / "input_keys.txt").read_text(encoding="utf-8").splitlines()
    keys = {tuple(cell.strip() for cell in row.split("|")[:2]) for row in rows}
    text = "\n".join(path.read_text(encoding="utf-8") for path in sources() if layer_of(path) in LAYERS_WITHOUT_INPUT)
    types = dict(re.findall(r"^   type :: (\w+)\n(.*?)^   (?:contains|end type)", text, re.MULTILINE | re.DOTALL))
    stages = {stage: name for name, stage in re.findall(r"type\((\w+)\) :: (\w+)", types["options_t"])}
    words = [words for line in text.splitlines() for words in TEXT.findall(line.partition("!>")[0])]
    named = {name for of_text in words for name in OPTION.findall(of_text)}
    assert len(named) > 5
    for name in sorted(named):
        stage, option = name.split("%")
        assert (stage, option) in keys, f"{name} is not a path of the input"
        assert re.search(rf":: {option}\b", types[stages[stage]]), f"options%{name} does not exist"


@for_all_sources
def test_use_statements_name_what_they_use(path):
    """`use ..., only:` everywhere; outside extern/ without exception."""
    if layer_of(path) == "extern":
        return
    for number, statement in statements(path):
        if USE.match(statement):
            assert re.search(r",\s*only\s*:", statement, re.IGNORECASE), (
                f"{path.relative_to(ROOT)}:{number}: '{statement}' has no 'only:'"
            )


@for_all_sources
def test_lists_of_names_stand_in_the_order_of_the_alphabet(path):
    """Modules are in alphabetical order in `use`, intrinsic ones first, and so are the names of each statement."""
    before = None
    for number, statement in statements(path):
        match = USE.match(statement)
        if not match:
            before = None
            continue
        here = (match.group(1) is None, match.group(2).lower())
        assert before is None or before <= here, f"{path.relative_to(ROOT)}:{number}: {match.group(2)} stands too late"
        before = here
        names = [name.split("=>")[0].strip().lower() for name in statement.partition("only:")[2].split(",")]
        assert names == sorted(names), f"{path.relative_to(ROOT)}:{number}: sort {', '.join(names)}"


PROCEDURE = re.compile(r"(?:[\w()=*:]+\s+)*?(?:subroutine|function)\s+(\w+)\s*\(([^)]*)\)", re.IGNORECASE)
MAX_ARGUMENTS = 8


@for_all_sources
def test_procedures_have_few_arguments(path):
    """Interfaces of other libraries are in extern/."""
    if layer_of(path) == "extern":
        return
    for number, statement in statements(path):
        if match := PROCEDURE.match(statement):
            n = len(match.group(2).split(","))
            assert n <= MAX_ARGUMENTS, f"{match.group(1)}, line {number}, has {n} arguments, more than {MAX_ARGUMENTS}"


FUNCTION = re.compile(r"(?:(?:pure|elemental|impure|recursive)\s+)*function\s+(\w+)\s*\([^)]*\)(?:\s*result\s*\((\w+)\))?", re.I)
DEFERRED_LENGTH = re.compile(r"character\s*\(\s*:\s*\)[^:]*allocatable[^:]*::(.*)", re.IGNORECASE)
IN_ONE_THREAD = "extern", "files", "study"  # their texts are made by the command, which has one thread


@for_all_sources
def test_functions_return_no_text_of_deferred_length(path):
    """Gfortran stores the length in static memory, which threads would share."""
    if layer_of(path) in IN_ONE_THREAD:
        return
    name, found = "", ""
    for number, statement in statements(path):
        if match := FUNCTION.match(statement):
            name, found = match.group(1), match.group(2) or match.group(1)
        elif re.match(r"end\s+(?:function|subroutine)|contains", statement, re.IGNORECASE):
            name = found = ""
        elif found and (match := DEFERRED_LENGTH.match(statement)):
            assert found not in re.findall(r"\w+", match.group(1)), f"{name}, line {number}: make it a subroutine"


@functools.cache
def _polymorphic_types() -> set[str]:
    """Types with a polymorphic allocatable component, also one of their components or of what they extend."""
    found: set[str] = set()
    parts: dict[str, set[str]] = {}
    for path in sources():
        name = ""
        for _, text in statements(path):
            code = text.strip()
            head = re.match(r"type(?!\s*\()(.*?)(?:::)?\s*(\w+)$", code)
            if head:
                name = head[2]
                parts.setdefault(name, set()).update(re.findall(r"extends\((\w+)\)", head[1]))
            elif code.startswith(("end type", "contains")):
                name = ""
            elif name and re.match(r"class\(\w+\)[^:]*allocatable", code):
                found.add(name)
            elif name and "pointer" not in code.split("::")[0]:
                parts[name].update(re.findall(r"^type\((\w+)\)", code))
    while more := {name for name, held in parts.items() if name not in found and held & found}:
        found |= more
    return found


@for_all_sources
def test_pure_functions_return_nothing_polymorphic(path):
    """Fortran 2018, section 15.7: gfortran compiles such functions up to version 15, and refuses them from 16 on."""
    lines = statements(path)
    wrong = []
    for i, (number, text) in enumerate(lines):
        head = re.match(r"\s*((?:[\w()=]+\s+)*)function\s+(\w+)\s*\([^)]*\)\s*(?:result\((\w+)\))?", text)
        if not head or not {"pure", "elemental"} & set(head[1].split()) or text.strip().startswith("end"):
            continue
        kind = re.search(r"type\((\w+)\)", head[1])
        result = re.compile(rf"\s*type\((\w+)\).*::.*\b{head[3] or head[2]}\b")
        kinds = [kind[1]] if kind else []
        for _, later in lines[i + 1 :]:
            if later.strip().startswith("end function"):
                break
            kinds += [found[1] for found in [result.match(later)] if found]
        wrong += [f"line {number}: {head[2]} returns {name}" for name in kinds if name in _polymorphic_types()]
    assert not wrong, f"{path.name}: " + ", ".join(wrong)


def _documented() -> set[str]:
    """Procedures with a line of documentation before them, in any file; for bodies of submodules it is in the interface."""
    heads = r"(?:subroutine|function|module\s+procedure)"
    named = re.compile(rf"^\s*!>.*\n\s*(?:[\w()=*:]+\s+)*?{heads}\s+(\w+)", re.MULTILINE | re.IGNORECASE)
    return {name.lower() for path in sources() for name in named.findall(path.read_text(encoding="utf-8"))}


def _bindings() -> dict[str, tuple[str, dict[str, str]]]:
    """For each type its parent, and the procedure of each binding; none for a deferred binding."""
    types: dict[str, tuple[str, dict[str, str]]] = {}
    for path in sources():
        inside = ""
        for _, statement in statements(path):
            lower = statement.lower()
            if match := re.match(r"type\b(?!\s*\()([^:]*)(?:::)?\s*(\w+)$", lower):
                parent = re.search(r"extends\((\w+)\)", match.group(1))
                inside = match.group(2)
                types.setdefault(inside, (parent.group(1) if parent else "", {}))
            elif lower.startswith("end type"):
                inside = ""
            elif inside and (match := re.match(r"procedure\s*(\(\w+\))?[^:]*::\s*(.*)", lower)):
                for item in match.group(2).split(","):
                    name, _, body = (part.strip() for part in item.partition("=>"))
                    types[inside][1][name] = "" if match.group(1) else body or name
    return types


def test_public_procedures_say_what_they_do():
    """The public procedures of a module, and bindings; an overriding procedure is documented where its binding is declared."""
    asked: dict[str, str] = {}
    for path in sources():
        lists = [s.lower()[9:] for _, s in statements(path) if s.lower().startswith("public ::")]
        for name in set(re.findall(r"\w+", " ".join(lists))) & _defined(path):
            asked[name] = str(path.relative_to(ROOT))
    types = _bindings()
    for name, (parent, bindings) in types.items():
        for binding, body in bindings.items():
            above = parent
            while above and binding not in types[above][1]:
                above = types[above][0]
            if body and not above:
                asked[body] = f"a binding of {name}"
    silent = sorted(f"{name}, {where}" for name, where in asked.items() if name not in _documented_procedures)
    assert not silent, "no line of documentation: " + "; ".join(silent)


_documented_procedures = _documented()


PAGE = (ROOT / "docs" / "develop" / "architecture.md").read_text(encoding="utf-8")


def test_layers_are_documented():
    """docs/develop/architecture.md lists the layers in this order."""
    table = PAGE[PAGE.index("| folder of `src/` |") :]
    assert re.findall(r"^\| `(\w+)` \|", table[: table.index("\n\n")], re.MULTILINE) == LAYERS


def test_the_page_is_read_in_minutes():
    assert len(PAGE.split()) <= 1500


def test_picture_of_the_layers_is_that_of_the_sources():
    run = subprocess.run([sys.executable, ROOT / "tests" / "layers", "--check"], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    picture = (ROOT / "docs" / "pictures" / "layers.svg").read_text(encoding="utf-8")
    assert re.findall(r'font-weight="bold">(\w+)<', picture) == LAYERS[::-1] and picture.count("<circle") > 40


def test_documented_modules_exist():
    """The page names modules where this helps, and only existing ones."""
    gone = {name for name in re.findall(r"`(hb_\w+)(?:\.f90)?`", PAGE) if name not in LAYER_OF_MODULE}
    assert not gone, f"docs/develop/architecture.md names {', '.join(sorted(gone))}, which are not in src/"


def test_page_is_no_list_of_modules():
    """The purpose of a module is described at the top of its file, once; a page that repeats it becomes wrong with the next
    change."""
    named = {name for name in re.findall(r"\bhb_\w+", PAGE) if name in LAYER_OF_MODULE}
    assert len(named) < len(LAYER_OF_MODULE) / 4, f"docs/develop/architecture.md names {len(named)} modules"


TYPE = re.compile(r"^type\b\s*(?:,[^:]*)?(?:::)?\s*(\w+)$", re.IGNORECASE)
POINTER = re.compile(r"^(?:type|class)\s*\(\s*(\w+)\s*\)\s*,.*\bpointer\b.*::", re.IGNORECASE)
DUMMY = re.compile(r"^(?:type|class)\s*\(\s*(\w+)\s*\)(.*\bintent\b.*)::(.*)$", re.IGNORECASE)


def _holders() -> set[tuple[str, str]]:
    """Pairs of a type and another to which it keeps a pointer."""
    pairs = set()
    for path in sources():
        inside = ""
        for _, statement in statements(path):
            if match := TYPE.match(statement):
                inside = match.group(1).lower()
            elif re.match(r"end\s*type\b|contains\b", statement, re.IGNORECASE):
                inside = ""
            elif inside and (match := POINTER.match(statement)):
                pairs.add((inside, match.group(1).lower()))
    return pairs


HOLDERS = _holders()


@for_all_sources
def test_groups_of_studies_are_read_by_studies(path):
    """The solution of one motion receives what it needs as arguments; a caller without an input gets the same result."""
    if layer_of(path) in ("study", "api"):
        return
    looked_up = re.findall(
        r"%\s*(?:count|group|optional_group|required_group)\(\"(curve|sweep)\"", path.read_text(encoding="utf-8")
    )
    assert not looked_up


@for_all_sources
def test_what_is_pointed_to_is_a_target(path):
    """If a procedure receives an object and another that points to such an object, the compiler must know that they may be the
    same."""
    dummies: dict[str, str] = {}  # attributes by type, of all dummies of a procedure
    wrong = ""
    for number, statement in [*statements(path), (0, "end subroutine")]:
        if re.match(r"end\s*(subroutine|function|procedure|interface)\b", statement, re.IGNORECASE):
            assert not wrong, wrong
            dummies = {}
        if match := DUMMY.match(statement):
            dummies[match.group(1).lower()] = dummies.get(match.group(1).lower(), "") + match.group(2).lower()
            wrong = ""
        for holder, held in HOLDERS:
            if match and holder in dummies and held in dummies and not re.search("target|pointer", dummies[held]):
                wrong = f"{path.relative_to(ROOT)}:{number}: a {holder} may point to the {held}, which is not a target"


# Copies of a system whose numbers change: on both sides of a value, at the frequencies of a start, along its ties.
MOVED_SYSTEMS = {("hb_gradient", "there"), ("hb_balance_branch_start", "found"), ("hb_orbit_branch", "whole")}
# Copied to change settings alone, because `solve_to_tolerance` takes a whole model; to be mended there.
COPIED_SYSTEMS = {("hb_census", "own")}
WHOLE = re.compile(r"^type\s*\(\s*(?:model_t|system_t)\s*\)(?!.*\b(?:intent|pointer)\b).*::\s*(\w+)", re.IGNORECASE)


@for_all_sources
def test_no_system_is_copied_to_change_a_setting(path):
    """What solves a motion changes the discretisation or the options of a system, which are values."""
    if layer_of(path) not in ("balance", "stability", "motion", "timedomain"):
        return
    is_in_type = False
    for number, statement in statements(path):
        if TYPE.match(statement):
            is_in_type = True
        elif re.match(r"end\s*type\b", statement, re.IGNORECASE):
            is_in_type = False
        match = WHOLE.match(statement)
        if match and not is_in_type:
            assert (path.stem, match.group(1)) in MOVED_SYSTEMS | COPIED_SYSTEMS, f"{path.relative_to(ROOT)}:{number}: {statement}"


def test_compiler_options_stand_in_one_file():
    """In cmake/Flags.cmake, each for the compiler that knows it: another compiler must not receive an option of gfortran."""
    option = re.compile(r"(?:^|[\s;\"(:])(-(?:std=|f[a-z]|W(?!l,)[a-z]|m[a-z]+=|O[0-9g])[\w=,-]*)")
    for path in sorted(ROOT.rglob("CMakeLists.txt")) + sorted((ROOT / "cmake").glob("*.cmake")):
        if "build" in path.relative_to(ROOT).parts or path.name == "Flags.cmake":
            continue
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
            found = option.search(line.partition("#")[0])
            assert not found, (
                f"{path.relative_to(ROOT)}:{number}: '{found.group(1)}'; options of compilers stand in cmake/Flags.cmake"
            )
    flags = (ROOT / "cmake" / "Flags.cmake").read_text(encoding="utf-8")
    for entry in re.findall(r"^[^#\n]*?[\s:]-f(?!sanitize|no-omit)[a-z]", flags, re.MULTILINE):
        assert "ID:" in entry, f"cmake/Flags.cmake: no compiler is named in '{entry}'"
