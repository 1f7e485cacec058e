"""Reads a pFUnit test file (.pf): rewrites its assertions and finds its tests and fixtures.

Accepted is a subset of what pFUnit 4.x accepts. Whatever pFUnit would skip without a word (a trailing comment
after a directive, a prefix before `subroutine`, ...), misread or not compile is refused here, with file and line.
"""

import re
from dataclasses import dataclass, field
from pathlib import Path

MAX_COLUMNS = 120  # the generated call is a few columns longer and has to stay below 132
MAX_TEST_NAME = 44
MAX_NAME_OF_CASE = 37  # of a test in a file with @testCase
MAX_WITH_FIXTURE = 105  # characters of a test and of what stands before and after it
RESERVED = {"t", "suite", "test", "run", "initialize", "finalize", "stub", "throw", "catch"}
# what `use funit` of pFUnit 4.14 exports and tests do not use: other meanings of these names at module level do not compile
EXPORTED = set("""near is not every every_item subject expectation predicate disable starts_with ends_with contains_string any_of
all_of equal_to relatively_near parallelcontext whitespaceoptions get_context trim_all empty_array ignore_all matchable
wascalled""".split())
PARENTS = {name.lower(): name for name in ("TestCase", "ParameterizedTestCase", "MpiTestCase")}

# assertion: (fewest positional arguments, most, keywords, keywords that must be there)
_COMPARE = (2, 2, {"tolerance", "message"}, set())
_CONDITION = (1, 1, {"message"}, set())
ASSERTIONS = {
    **dict.fromkeys(["equal", "notequal"], _COMPARE),
    **dict.fromkeys(["lessthan", "lessthanorequal", "greaterthan", "greaterthanorequal"], _COMPARE),
    **dict.fromkeys(["true", "false", "any", "all", "isfinite", "isnan"], _CONDITION),
    "relativelyequal": (2, 2, {"tolerance", "message"}, {"tolerance"}),
    "fail": (1, 1, set(), set()),
    "exceptionraised": (0, 1, set(), set()),
}

# directive: options it knows
DIRECTIVES = {
    "test": {"npes", "ifdef", "ifndef", "testparameters"},
    "mpitest": {"npes", "ifdef", "ifndef", "testparameters"},
    "disable": set(),
    "before": set(),
    "after": set(),
    "testcase": {"constructor", "npes", "testparameters"},
    "testparameter": {"constructor"},
}

OPTION_VALUES = {"npes": r"\[\s*([1-9]\d*(?:\s*,\s*[1-9]\d*)*)\s*\]", "testparameters": r"\{(.+)\}"}  # else a name

STRING = re.compile(r"'[^']*'|\"[^\"]*\"")
SUBROUTINE = re.compile(r"\s*subroutine\s+(\w+)\s*(?:\(\s*([\w\s,]*?)\s*\))?\s*", re.I)
TYPE = re.compile(r"\s*type\s*,\s*extends\s*\(\s*(\w+)\s*\)\s*::\s*(\w+)\s*", re.I)
PROCEDURE = re.compile(r"\s*(?!end\b)(?:[\w()=*,:\s]*\s)?(?:subroutine|function)\s+(\w+)", re.I)


class Refused(Exception):
    """A line of the .pf file that the runner does not accept."""

    def __init__(self, line_number, reason):
        super().__init__(reason)
        self.line_number = line_number
        self.reason = reason


@dataclass
class Directive:
    """`@name(options)`, waiting for the line that it belongs to."""

    name: str
    line_number: int
    options: dict = field(default_factory=dict)
    disabled: bool = False


@dataclass
class Test:
    """A registered test procedure."""

    name: str
    directive: Directive
    n_arguments: int

    @property
    def npes(self):
        return self.directive.options.get("npes")


def blank_strings(text):
    """The same text, same length, with the inside of character literals replaced by `_`."""
    return STRING.sub(lambda match: '"' + "_" * (len(match[0]) - 2) + '"', text)


def code_of(line):
    """The line without comment and without the content of its character literals."""
    return blank_strings(line).partition("!")[0]


def split_arguments(text):
    """Split at the commas that stand outside all brackets and strings."""
    parts, depth, start = [], 0, 0
    plain = blank_strings(text)
    for i, char in enumerate(plain):
        depth += (char in "([{") - (char in ")]}")
        if char == "," and depth == 0:
            parts.append(text[start:i].strip())
            start = i + 1
    parts.append(text[start:].strip())
    return [] if parts == [""] else parts


class TestFile:
    """One .pf file: its Fortran lines, and what its suite has to run."""

    def __init__(self, path):
        self.path = Path(path)
        self.line_number = 1
        self.lines = []  # the module, directives rewritten
        self.module = None
        self.base = None  # funit or pfunit
        self.places = {}  # of 'module', 'use' and 'end': (index in `lines`, line number)
        self.pending = None
        self.in_declarations = True  # of the module, until its 'contains'
        self.in_block = False
        self.statement = ""  # of the declarations, as far as its lines have been read
        self.tests = []
        self.fixture = {}  # before, after: (procedure name, number of arguments, line)
        self.case = None  # (type name, parent, directive) of @testCase
        self.parameter = None  # (type name, directive) of @testParameter

        self.read()
        self.check_file()

    def read(self):
        for self.line_number, line in enumerate(self.path.read_text(encoding="utf-8").splitlines(), 1):
            if line.lstrip().startswith("@"):
                self.read_directive(line)
            else:
                self.read_ordinary_line(line)
        if self.pending:
            self.reject_dangling()

    def refuse(self, reason, line_number=None):
        raise Refused(line_number or self.line_number, reason)

    def reject_dangling(self):
        is_type = self.pending.name in ("testcase", "testparameter")
        what = "type, extends(...) :: name" if is_type else "subroutine name(...)"
        self.refuse(f"@{self.pending.name} must be followed by a line that is only '{what}' "
                    "(comments and blank lines may stand between)", self.pending.line_number)

    # --- reading ---

    def read_ordinary_line(self, line):
        code = code_of(line).strip()
        self.lines.append(line)
        if not code:
            return
        if re.search(r"@\s*\w", code):
            self.refuse("a directive stands alone on its line")
        if self.pending:
            self.attach(line.rstrip())
        if re.match(r"module\b(?!\s+(procedure|subroutine|function)\b)", code, re.I):
            self.read_module_line(line)
        elif re.match(r"use\b.*\bp?funit\b", code, re.I):
            self.read_use_line(code)
        elif re.match(r"end\s*module\b", code, re.I):
            self.note_place("end")
        elif self.in_declarations:
            self.statement += " " + code.strip("&").strip()
            if not code.endswith("&"):
                self.read_declaration(self.statement.strip())
                self.statement = ""
        procedure = PROCEDURE.match(code)
        if procedure:
            self.check_name(procedure[1])

    def note_place(self, name):
        self.places[name] = (len(self.lines) - 1, self.line_number)

    def read_module_line(self, line):
        match = re.fullmatch(r"\s*module\s+(\w+)\s*", line, re.I)
        if not match:
            self.refuse("the line 'module name' must carry nothing else")
        if self.module:
            self.refuse("one module in a test file")
        self.module = match[1]
        self.note_place("module")
        if self.module != self.path.stem:
            self.refuse(f"module '{self.module}' must be named like its file, '{self.path.stem}'")

    def read_use_line(self, code):
        match = re.fullmatch(r"use\s+(p?funit)", code, re.I)
        if not match:
            self.refuse("write 'use funit' or 'use pfunit', without 'only' or renaming")
        self.base = match[1].lower()
        self.note_place("use")

    def read_declaration(self, code):
        """A statement between `module` and its `contains`; inside of types and interfaces nothing matters."""
        if re.match(r"(type\b(?!\s*\()|(abstract\s+)?interface\b)", code, re.I):
            self.in_block = True
        elif re.match(r"end\s*(type|interface)\b", code, re.I):
            self.in_block = False
        elif not self.in_block and code.lower() == "contains":
            self.in_declarations = False
        elif not self.in_block and code.lower() == "private":
            self.refuse("a test module stays public: its suite has to see the tests")
        elif not self.in_block and "::" in code:
            for entity in split_arguments(code.split("::")[1]):
                self.check_name(re.split(r"[(=]", entity)[0].strip())
        used = re.match(r"use\b[^:]*?,\s*only\s*:(.*)", code, re.I)
        for entity in split_arguments(used[1]) if used else []:
            self.check_name(entity.split("=>")[0].strip())

    def check_name(self, name):
        if name.lower() in RESERVED | EXPORTED:
            self.refuse(f"the name '{name}' belongs to the test framework")

    def read_directive(self, line):
        if len(line.rstrip()) > MAX_COLUMNS:
            self.refuse(f"a directive ends before column {MAX_COLUMNS + 1}")
        name, arguments = self.split_directive(line.strip())
        if name.startswith("assert") and name[6:] in ASSERTIONS:
            self.write_assertion(line, name[6:], arguments)
        elif name.startswith(("assert", "mpiassert")):
            self.refuse(f"@{name} is not an accepted assertion")
        elif name not in DIRECTIVES:
            self.refuse(f"@{name} is not an accepted directive")
        else:
            self.lines.append(line.replace("@", "!@", 1))
            self.open_directive(name, arguments)

    def split_directive(self, text):
        """Name in lower case and the list of arguments (None: no parentheses) of a directive line."""
        match = re.match(r"@(\w+)\s*", text)
        if not match:
            self.refuse("'@' must be followed by the name of a directive")
        rest = text[match.end():]
        arguments = None
        if rest.startswith("("):
            depth = 0
            for i, char in enumerate(blank_strings(rest)):
                depth += (char in "([{") - (char in ")]}")
                if depth == 0:
                    break
            if depth:
                self.refuse("a directive is one whole line: ')' is missing, continuation is not possible")
            arguments, rest = split_arguments(rest[1:i]), rest[i + 1:].strip()
        if rest.startswith("!"):
            self.refuse("no comment may follow a directive")
        if rest.endswith("&"):
            self.refuse("a directive cannot be continued")
        if rest:
            self.refuse(f"unexpected text after the directive: '{rest}'")
        return match[1].lower(), arguments

    def write_assertion(self, line, name, arguments):
        if arguments is None:
            self.refuse(f"@assert{name} needs parentheses")
        if self.pending:
            self.reject_dangling()
        fewest, most, known, required = ASSERTIONS[name]
        keywords = [re.match(r"(\w+)\s*=(?!=)", argument) for argument in arguments]
        positional = [key is None for key in keywords]
        used = {key[1].lower() for key in keywords if key}
        if not fewest <= sum(positional) <= most or "" in arguments or False in positional[:sum(positional)]:
            count = f"{fewest} to {most}" if fewest < most else f"{fewest}"
            self.refuse(f"@assert{name} takes {count} positional argument(s), "
                        f"then as keywords: {', '.join(sorted(known)) or 'none'}")
        if used - known:
            self.refuse(f"@assert{name} knows no argument '{sorted(used - known)[0]}'")
        if required - used:
            self.refuse(f"@assert{name} requires {', '.join(sorted(required))}=")
        indent, call = re.match(r"(\s*)@(\w+)", line).groups()
        text = "".join(argument + ", " for argument in arguments)
        self.lines += [
            f'#line {self.line_number} "{self.path}"',
            f"{indent}call {call}({text}&",
            f'{indent}& location=SourceLocation("{self.path.name}", {self.line_number}))',
            f"{indent}if (anyExceptions()) return",
            f'#line {self.line_number + 1} "{self.path}"',
        ]

    def open_directive(self, name, arguments):
        if name == "disable":
            if not self.pending or self.pending.name != "test":
                self.refuse("@disable stands between @test and its subroutine")
            self.pending.disabled = True
            return
        if self.pending:
            self.reject_dangling()
        directive = Directive("test" if name == "mpitest" else name, self.line_number)
        for argument in arguments or []:
            match = re.fullmatch(r"(\w+)\s*=\s*(.+)", argument)
            key = match[1].lower() if match else argument
            if key not in DIRECTIVES[name] or key in directive.options:
                self.refuse(f"@{name}: option '{key}' is unknown or given twice; "
                            f"known: {', '.join(sorted(DIRECTIVES[name])) or 'none'}")
            directive.options[key] = self.read_option(name, key, match[2])
        if name == "mpitest" and "npes" not in directive.options:
            self.refuse("@mpiTest requires npes=[...]")
        self.pending = directive

    def read_option(self, name, key, value):
        match = re.fullmatch(OPTION_VALUES.get(key, r"(\w+)"), value)
        if not match:
            self.refuse(f"@{name}: '{key}={value}' is not understood, expected npes=[1,2] (numbers only), "
                        "testParameters={expression}, constructor=name, ifdef=NAME")
        return [int(number) for number in match[1].split(",")] if key == "npes" else match[1]

    def attach(self, line):
        """Bind the pending directive to this line."""
        directive = self.pending
        match = (TYPE if directive.name in ("testcase", "testparameter") else SUBROUTINE).fullmatch(line)
        if not match:
            self.reject_dangling()
        self.pending = None
        if directive.name == "testcase":
            if self.case:
                self.refuse("one @testCase in a file")
            if match[1].lower() not in PARENTS:
                self.refuse(f"a test case extends one of {', '.join(PARENTS.values())}, not '{match[1]}'")
            self.case = (match[2], PARENTS[match[1].lower()], directive)
        elif directive.name == "testparameter":
            if self.parameter:
                self.refuse("one @testParameter in a file")
            self.parameter = (match[2], directive)
        elif directive.name == "test":
            if len(match[1]) > MAX_TEST_NAME:
                self.refuse(f"a test name has at most {MAX_TEST_NAME} characters")
            if any(match[1].lower() == test.name.lower() for test in self.tests):
                self.refuse(f"test '{match[1]}' is there twice")
            self.tests.append(Test(match[1], directive, len(split_arguments(match[2] or ""))))
        else:
            if directive.name in self.fixture:
                self.refuse(f"one @{directive.name} in a file")
            n_arguments = len(split_arguments(match[2] or ""))
            self.fixture[directive.name] = (match[1], n_arguments, directive.line_number)

    # --- what only the whole file tells ---

    @property
    def is_mpi(self):
        return any(test.npes for test in self.tests) or bool(self.case and "npes" in self.case[2].options)

    def check_file(self):
        if not self.module:
            self.refuse("tests live in a module named like the file")
        if "end" not in self.places:
            self.refuse(f"the module ends with 'end module {self.module}'")
        if not self.base:
            self.refuse("'use funit' (serial) or 'use pfunit' (MPI) is missing")
        if not self.tests:
            self.refuse("no @test in this file")
        if self.is_mpi and self.base != "pfunit":
            self.refuse("a file with npes= says 'use pfunit'")
        if self.parameter and not self.case:
            self.refuse("@testParameter without @testCase", self.parameter[1].line_number)
        for test in self.tests:
            self.check_test(test)
            self.check_length(test)
        if self.case:
            self.check_case()
        for kind, (_, n_arguments, line_number) in self.fixture.items():
            if self.case:
                self.refuse(f"@{kind} has no effect in a file with @testCase: use setUp, tearDown", line_number)
            if self.is_mpi and len(self.fixture) < 2:
                self.refuse("an MPI file has both @before and @after, or none", line_number)
            if self.is_mpi and not all(test.npes for test in self.tests):
                self.refuse(f"with @{kind}, all tests of the file are MPI tests or none is", line_number)
            if n_arguments != (1 if self.is_mpi else 0):
                self.refuse(f"the @{kind} procedure takes {'this' if self.is_mpi else 'no arguments'}", line_number)

    def check_test(self, test):
        line_number, options = test.directive.line_number, test.directive.options
        takes_this = bool(self.case or test.npes)
        if test.n_arguments != takes_this:
            self.refuse(f"test '{test.name}' takes {'one argument' if takes_this else 'no arguments'}", line_number)
        if "ifdef" in options and "ifndef" in options:
            self.refuse("ifdef= or ifndef=, not both", line_number)
        if self.case and test.directive.disabled:
            self.refuse("@disable has no effect in a file with @testCase", line_number)
        if not self.parameter and "testparameters" in options:
            self.refuse("testParameters= needs a @testParameter type in this file", line_number)
        if self.parameter and self.case and not self.parameters_of(test):
            self.refuse(f"test '{test.name}' has no testParameters=, neither has its @testCase", line_number)

    def check_length(self, test):
        """pFUnit writes the names into one line of Fortran."""
        line_number = test.directive.line_number
        if self.case and len(test.name) > MAX_NAME_OF_CASE:
            self.refuse(f"a test of a file with @testCase has at most {MAX_NAME_OF_CASE} characters", line_number)
        if len(test.name) + sum(len(name) for name, _, _ in self.fixture.values()) > MAX_WITH_FIXTURE:
            self.refuse(f"a test, @before and @after have at most {MAX_WITH_FIXTURE} characters together", line_number)

    def check_case(self):
        _, parent, directive = self.case
        options, line_number = directive.options, directive.line_number
        if (parent == "MpiTestCase") != self.is_mpi:
            self.refuse("npes= and extends(MpiTestCase) belong together", line_number)
        if self.parameter and parent == "TestCase":
            self.refuse("a case with parameters extends ParameterizedTestCase or MpiTestCase", line_number)
        if self.parameter and "constructor" not in options:
            self.refuse("a case with parameters needs @testCase(constructor=...)", line_number)
        if not self.parameter and "testparameters" in options:
            self.refuse("testParameters= needs a @testParameter type in this file", line_number)

    def parameters_of(self, test):
        return test.directive.options.get("testparameters") or self.case[2].options.get("testparameters")
