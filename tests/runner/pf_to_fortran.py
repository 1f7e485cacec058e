#!/usr/bin/env python3
"""Translate a pFUnit test file (.pf) into Fortran for the in-tree test runner.

    pf_to_fortran.py test_thing.pf test_thing.F90 [--main RUNNER SUITE...]

The output is the module with its directives rewritten and one more subroutine, `test_thing_suite`, that runs the
tests in the order of the file. With --main, the main program that runs these suites by the module RUNNER follows. It
has to be compiled with the C preprocessor, because `#line` keeps compiler messages and debuggers at the .pf file.

The suite stands in the module, and the main program finds it by its name for the linker, so that nobody has to read
the module file of a test, which holds every type that the test can reach.
"""

import sys
from pathlib import Path

from pf_reader import Refused, TestFile

METHOD_INTERFACE = """\
   abstract interface
      subroutine runner_method(this)
         import :: {type}
         class({type}), intent(inout) :: this
      end subroutine runner_method
   end interface"""

SERIAL_CASE = """\
   subroutine runner_case(label, method{argument})
      character(*), intent(in) :: label
      procedure(runner_method) :: method{declaration}
      type({type}) :: fixture

      if (.not. runner_wants(label)) return{construct}
      call fixture%setUp()
      if (.not. anyExceptions()) then
         call method(fixture)
         call fixture%tearDown()
      end if
      call runner_finish()
   end subroutine runner_case"""

MPI_CASE = """\
   subroutine runner_case(label, method{argument})
      character(*), intent(in) :: label
      procedure(runner_method) :: method{declaration}
      type({type}) :: fixture

      if (.not. runner_wants_mpi(label, parameter%getNumProcessesRequested())) return{construct}
      call runner_enter(fixture, parameter%getNumProcessesRequested())
      if (runner_takes_part(fixture)) then
         call fixture%setUp()
         if (.not. runner_any_failed(fixture)) then
            call method(fixture)
            call fixture%tearDown()
         end if
      end if
      call runner_finish_mpi(fixture)
   end subroutine runner_case"""

ALL_CASES = """\
   subroutine runner_cases(name, method, parameters{argument})
      character(*), intent(in) :: name
      procedure(runner_method) :: method
      type({parameter}), intent(in) :: parameters(:){declaration}
      type({parameter}) :: parameter
      integer :: i

      do i = 1, size(parameters)
         parameter = parameters(i){set_processes}
         call runner_case({label}, method, parameter)
      end do
   end subroutine runner_cases"""


def suite_head(suite):
    """The first line of the subroutine that runs a suite, with the name that it has for the linker."""
    return f'subroutine {suite}() bind(c, name="{suite}")'


def suite_lines(file):
    """The subroutine `<module>_suite`."""
    head = [suite_head(f"{file.module}_suite"),
            "   use runner_session, only: runner_finish, runner_run, runner_skip, runner_wants"]
    if file.base == "pfunit":
        head += ["   use runner_mpi, only: runner_any_failed, runner_enter, runner_finish_mpi, runner_run_mpi, &",
                 "      & runner_takes_part, runner_wants_mpi"]
    if file.case:
        body = case_body(file)
    else:
        body = [line for test in file.tests for line in guarded(test, plain_calls(file, test))]
    return [*head, "   implicit none", *body, f"end subroutine {file.module}_suite"]


def main_lines(runner, suites):
    """The main program that runs some suites."""
    interfaces = [line for suite in suites for line in (f"      {suite_head(suite)}", f"      end subroutine {suite}")]
    calls = [f"   call {suite}()" for suite in suites]
    return ["program runner_main", f"   use {runner}, only: finish_run, start_run", "   implicit none", "   interface",
            *interfaces, "   end interface", "", "   call start_run()", *calls, "   call finish_run()",
            "end program runner_main"]


def module_lines(file, target):
    """The module with its suite before its end.

    The framework is used first, on the line of the name: gfortran compares each name of a module that is used without
    `only` with all it knows by then, and `pfunit` has the thousands of names of `mpi`.
    """
    lines = list(file.lines)
    lines[file.places["use"][0]] = ""
    lines[file.places["module"][0]] += f"; use {file.base}"
    end, end_line = file.places["end"]
    # in the suite the compiler is to speak of the generated file
    suite = [f'#line {end + 2} "{target}"', *suite_lines(file), f'#line {end_line} "{file.path}"']
    return lines[:end] + suite + lines[end:]


def guarded(test, lines):
    """The lines, inside the #ifdef of the test if it has one."""
    options = test.directive.options
    guard = [f"#{key} {options[key]}" for key in ("ifdef", "ifndef") if key in options]
    return guard + lines + ["#endif"]*len(guard)


def plain_calls(file, test):
    """Calls of a test without fixture type."""
    label = f'"{file.module}.{test.name}"'
    fixture = "".join(f", &\n      & {kind}={name}" for kind, (name, _, _) in file.fixture.items())
    if test.directive.disabled:
        return [f"   call runner_skip({label})" for _ in test.npes or [None]]
    if test.npes:
        return [f"   call runner_run_mpi({label}, {npes}, &\n      & {test.name}{fixture})" for npes in test.npes]
    return [f"   call runner_run({label}, &\n      & {test.name}{fixture})"]


def case_body(file):
    """Declarations, calls and internal procedures of a file with @testCase."""
    type_name, parent, directive = file.case
    is_mpi = parent == "MpiTestCase"
    # an MPI case always has a parameter: it carries the number of processes
    parameter = file.parameter[0] if file.parameter else "MpiTestParameter" if is_mpi else None
    constructor = directive.options.get("constructor")
    lines = [METHOD_INTERFACE.format(type=type_name)]
    for test in file.tests:
        lines += guarded(test, case_calls(file, test, is_mpi))
    lines += ["contains", (MPI_CASE if is_mpi else SERIAL_CASE).format(
        type=type_name,
        argument=", parameter" if parameter else "",
        declaration=f"\n      type({parameter}), intent(in) :: parameter" if parameter else "",
        construct=f"\n      fixture = {constructor}({'parameter' if parameter else ''})" if constructor else "")]
    if parameter:
        lines.append(ALL_CASES.format(
            parameter=parameter,
            argument=", npes" if is_mpi else "",
            declaration="\n      integer, intent(in) :: npes" if is_mpi else "",
            set_processes="\n         call parameter%setNumProcessesRequested(npes)" if is_mpi else "",
            label='name//" ["//parameter%toString()//"]"' if file.parameter else "name"))
    return lines


def case_calls(file, test, is_mpi):
    """Calls of a test, one for each number of processes."""
    label = f'"{file.module}.{test.name}"'
    if not file.parameter and not is_mpi:
        return [f"   call runner_case({label}, &\n      & {test.name})"]
    parameters = file.parameters_of(test) if file.parameter else "[MpiTestParameter(1)]"
    call = f"   call runner_cases({label}, &\n      & {test.name}, &\n      & {parameters}"
    if not is_mpi:
        return [f"{call})"]
    return [f"{call}, &\n      & {npes})" for npes in test.npes or file.case[2].options.get("npes", [1])]


def main(arguments):
    if len(arguments) != 2 and not (len(arguments) > 4 and arguments[2] == "--main"):
        sys.exit("usage: pf_to_fortran.py <test.pf> <test.F90> [--main <runner> <suite>...]")
    source, target = map(Path, arguments[:2])
    try:
        file = TestFile(source)
    except Refused as refused:
        # the form that editors and continuous integration recognise
        sys.exit(f"{source}:{refused.line_number}: error: {refused.reason}")
    lines = module_lines(file, target)
    if len(arguments) > 2:
        lines += main_lines(arguments[3], arguments[4:])
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
