#!/usr/bin/env python3
"""Translate a pFUnit test file (.pf) into Fortran for the in-tree test runner.

    pf_to_fortran.py test_thing.pf test_thing.F90

The output is the module with its directives rewritten, followed by one external subroutine `test_thing_suite` that
runs the tests in the order of the file. It has to be compiled with the C preprocessor, because `#line` keeps
compiler messages and debuggers at the .pf file.
"""

import sys
from pathlib import Path

from pf_reader import Refused, TestFile

CASE_INTERFACE = """\
   abstract interface
      subroutine runner_method(this)
         import :: {type}
         class({type}), intent(inout) :: this
      end subroutine runner_method
   end interface"""

# fixture without parameters
CASE = """\
contains
   subroutine runner_case(name, method)
      character(*), intent(in) :: name
      procedure(runner_method) :: method
      type({type}) :: fixture

      if (.not. runner_wants(name)) return{construct}
      call fixture%setUp()
      if (.not. anyExceptions()) then
         call method(fixture)
         call fixture%tearDown()
      end if
      call runner_finish()
   end subroutine runner_case"""

# one fixture for each parameter; the calls in between are SERIAL_RUN or MPI_RUN
PARAMETER_CASE = """\
contains
   subroutine runner_case(name, method, npes, parameters)
      character(*), intent(in) :: name
      procedure(runner_method) :: method
      integer, intent(in) :: npes
      type({parameter}), intent(in) :: parameters(:)
      integer :: i

      do i = 1, size(parameters)
         call runner_single_case(name, method, npes, parameters(i))
      end do
   end subroutine runner_case"""
def suite_lines(file):
    """The subroutine `<module>_suite`."""
    head = [f"subroutine {file.module}_suite()",
            f"   use {file.module}",
            "   use runner_session, only: runner_finish, runner_run, runner_skip, runner_wants"]
    if file.base == "pfunit":
        head += ["   use runner_mpi, only: runner_any_failed, runner_enter, runner_finish_mpi, runner_run_mpi, &",
                 "      & runner_takes_part, runner_wants_mpi"]
    body = case_body(file) if file.case else [line for test in file.tests for line in guarded(test, plain_calls(file, test))]
    return [*head, "   implicit none", *body, f"end subroutine {file.module}_suite"]


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
    """Declarations, calls and the internal procedure of a file with @testCase."""
    type_name, parent, directive = file.case
    is_mpi = parent == "MpiTestCase"
    # an MPI case always has a parameter: it carries the number of processes
    parameter = file.parameter[0] if file.parameter else "MpiTestParameter" if is_mpi else None
    constructor = directive.options.get("constructor")
    lines = [CASE_DECLARATIONS.format(type=type_name)]
    if parameter:
        lines.append(PARAMETER_DECLARATIONS.format(parameter=parameter))
    if parameter and not file.parameter:
        lines.append("   allocate (runner_parameters(1))")
    for test in file.tests:
        lines += guarded(test, case_calls(file, test, bool(parameter), is_mpi))
    lines.append("contains\n" + (MPI_CASE if is_mpi else SERIAL_CASE).format(
        type=type_name,
        argument=", parameter" if parameter else "",
        declaration=f"\n      type({parameter}), intent(in) :: parameter" if parameter else "",
        label='name//" ["//parameter%toString()//"]"' if file.parameter else "name",
        construct=f"\n      fixture = {constructor}({'parameter' if parameter else ''})" if constructor else ""))
    return lines


def case_calls(file, test, has_parameter, is_mpi):
    """Calls of a test for each number of processes and each parameter."""
    call = f'call runner_case("{file.module}.{test.name}", &\n         & {test.name}'
    if not has_parameter:
        return [f"   {call})"]
    lines = []
    for npes in (test.npes or file.case[2].options.get("npes", [1])) if is_mpi else [None]:
        if file.parameter:
            lines.append(f"   runner_parameters = {file.parameters_of(test)}")
        lines.append("   do runner_i = 1, size(runner_parameters)")
        if npes:
            lines.append(f"      call runner_parameters(runner_i)%setNumProcessesRequested({npes})")
        lines += [f"      {call}, runner_parameters(runner_i))", "   end do"]
    return lines


def main(arguments):
    if len(arguments) != 2:
        sys.exit("usage: pf_to_fortran.py <test.pf> <test.F90>")
    source, target = map(Path, arguments)
    try:
        file = TestFile(source)
    except Refused as refused:
        # the form that editors and continuous integration recognise
        sys.exit(f"{source}:{refused.line_number}: error: {refused.reason}")
    # from here on the compiler is to speak of the generated file
    lines = [*file.lines, f'#line {len(file.lines) + 2} "{target}"', *suite_lines(file)]
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
