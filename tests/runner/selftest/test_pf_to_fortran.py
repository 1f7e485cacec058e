"""The preprocessor refuses, with file and line, what pFUnit would skip, misread or not compile."""

import subprocess
import sys
import tempfile
import textwrap
import unittest
from pathlib import Path

SCRIPT = Path(__file__).resolve().parent.parent / "pf_to_fortran.py"

PLAIN = """\
module test_thing
   use funit
   implicit none
contains
   @test
   subroutine test_a()
      @assertEqual(1, 1)
   end subroutine test_a
end module test_thing
"""

CASE = """\
module test_thing
   use funit
   implicit none
   @testParameter
   type, extends(AbstractTestParameter) :: row_t
   contains
      procedure :: toString
   end type row_t
   @testCase(constructor=new_case, testParameters={[row_t()]})
   type, extends(ParameterizedTestCase) :: case_t
   end type case_t
contains
   @test
   subroutine test_a(this)
      class(case_t), intent(inout) :: this
   end subroutine test_a
end module test_thing
"""


def translate(text, name="test_thing.pf"):
    """Exit status, message and output of the preprocessor for this text."""
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder, name), Path(folder, "out", "test_thing.F90")
        source.write_text(textwrap.dedent(text), encoding="utf-8")
        done = subprocess.run([sys.executable, "-B", SCRIPT, source, target], capture_output=True, text=True, check=False)
        return done.returncode, done.stderr.replace(folder + "/", ""), target.read_text() if target.exists() else None


class TestNamesOfPfunit(unittest.TestCase):
    """Names at module level that `use funit` of pFUnit exports: the file would not compile with it."""

    def refused(self, declaration):
        status, message, _ = translate(PLAIN.replace("   implicit none\n", declaration))
        return status != 0 and "belongs to the test framework" in message

    def test_declared_and_used_names_are_refused(self):
        self.assertTrue(self.refused("   implicit none\n   real :: near\n"))
        self.assertTrue(self.refused("   implicit none\n   real :: far, &\n      Every = 1.0\n"))
        self.assertTrue(self.refused("   use other, only: a_t, &\n      trim_all\n   implicit none\n"))
        self.assertTrue(self.refused("   use other, only: is => has\n   implicit none\n"))

    def test_other_names_are_accepted(self):
        self.assertFalse(self.refused("   use other, only: has => is\n   implicit none\n"
                                      "   real :: far = 1.0, nearest(2) = [1.0, &\n      2.0]\n"))

    def test_long_names_are_refused_where_cases_lengthen_them(self):
        for n, is_accepted in ((37, True), (38, False)):
            name = "test_" + "a" * (n - 5)
            self.assertEqual(translate(CASE.replace("test_a", name))[0] == 0, is_accepted)


class TestAccepted(unittest.TestCase):
    def test_assertion_becomes_call_at_its_line(self):
        status, message, output = translate(PLAIN)
        self.assertEqual((status, message), (0, ""))
        self.assertIn('call assertEqual(1, 1, &\n      & location=SourceLocation("test_thing.pf", 7))\n'
                      "      if (anyExceptions()) return\n#line 8 ", output)

    def test_each_test_is_run_once_in_order(self):
        text = PLAIN.replace("end module", "@test\n! comment\n\nsubroutine test_b\nend subroutine\nend module")
        _, _, output = translate(text)
        suite = output[output.index("subroutine test_thing_suite"):]
        self.assertEqual(suite.count("call runner_run"), 2)
        self.assertLess(suite.index("test_thing.test_a"), suite.index("test_thing.test_b"))

    def test_suite_stands_in_the_module(self):
        _, _, output = translate(PLAIN)
        self.assertTrue(output.startswith("module test_thing; use funit\n\n   implicit none"))
        self.assertLess(output.index("subroutine test_thing_suite"), output.index('#line 9 "'))
        self.assertTrue(output.rstrip().endswith("test_thing.pf\"\nend module test_thing"))

    def test_case_file_is_accepted(self):
        self.assertEqual(translate(CASE)[:2], (0, ""))

    def test_brackets_and_comments_in_strings_do_not_count(self):
        text = PLAIN.replace("(1, 1)", """("a), (b! &", 'it''s', message="@test, (")""")
        self.assertEqual(translate(text)[:2], (0, ""))

    def test_framework_names_are_free_inside_procedures_and_types(self):
        text = PLAIN.replace("implicit none\n", "implicit none\ntype :: a_t\ninteger :: t\nprivate\nend type\n")
        self.assertEqual(translate(text.replace("@assertEqual", "integer :: suite\n@assertEqual"))[:2], (0, ""))


class TestRefused(unittest.TestCase):
    def check(self, text, line, reason, name="test_thing.pf"):
        status, message, output = translate(text, name)
        self.assertNotEqual(status, 0)
        self.assertIsNone(output)
        self.assertTrue(message.startswith(f"{name}:{line}: error: "), message)
        self.assertIn(reason, message)

    def check_plain(self, old, new, line, reason):
        self.assertIn(old, PLAIN)
        self.check(PLAIN.replace(old, new), line, reason)

    def check_case(self, old, new, line, reason):
        self.assertIn(old, CASE)
        self.check(CASE.replace(old, new), line, reason)

    def check_assertion(self, assertion, reason):
        self.check_plain("@assertEqual(1, 1)", assertion, 7, reason)

    # the form of a directive

    def test_comment_after_directive(self):
        self.check_plain("@test\n", "@test ! first\n", 5, "no comment")
        self.check_assertion("@assertEqual(1, 1) ! one (1)", "no comment")

    def test_continuation(self):
        self.check_assertion("@assertEqual(1, &\n & 1)", "continuation")
        self.check_assertion("@assertEqual(1, 1) &", "cannot be continued")

    def test_text_after_directive(self):
        self.check_assertion("@assertEqual(1, 1); call f()", "unexpected text")

    def test_directive_behind_other_code(self):
        self.check_assertion("if (.true.) @assertEqual(1, 1)", "alone on its line")

    def test_long_directive(self):
        self.check_assertion("@assertEqual(" + "1 + "*30 + "1, 31)", "column 121")

    def test_unknown_directive(self):
        self.check_plain("@test\n", "@tests\n", 5, "@tests is not")
        self.check_plain("@test\n", "@suite(name='x')\n", 5, "@suite is not")

    def test_unknown_option(self):
        self.check_plain("@test\n", "@test(pes=[1])\n", 5, "'pes' is unknown")
        self.check_plain("@test\n", "@test(cases=[1])\n", 5, "'cases' is unknown")
        self.check_plain("@test\n", "@disable\n", 5, "@disable stands between")

    def test_process_counts_are_literal_numbers(self):
        for value in ("[n]", "1", "[0]", "[]"):
            self.check_plain("@test\n", f"@test(npes={value})\n", 5, "is not understood")

    # assertions

    def test_unknown_assertion(self):
        for name in ("assertIsInfinite", "assertEqu", "assertThat", "mpiAssertEqual"):
            self.check_assertion(f"@{name}(1, 1)", "not an accepted assertion")

    def test_arguments_of_assertions(self):
        self.check_assertion("@assertEqual(1)", "2 positional")
        self.check_assertion("@assertEqual(1, 1, 'text')", "2 positional")
        self.check_assertion("@assertEqual(1, message='text', 1)", "2 positional")
        self.check_assertion("@assertTrue(.true., tolerance=1.0)", "no argument 'tolerance'")
        self.check_assertion("@assertRelativelyEqual(1.0, 1.0)", "requires tolerance=")
        self.check_assertion("@assertTrue", "needs parentheses")

    # what a directive belongs to

    def test_prefix_before_subroutine(self):
        self.check_plain("subroutine test_a()", "impure subroutine test_a()", 5, "only 'subroutine name(...)'")
        self.check_plain("subroutine test_a()", "subroutine test_a() bind(c)", 5, "only 'subroutine name(...)'")

    def test_dangling_test(self):
        self.check_plain("@test\n", "@test\ninteger :: i\n", 5, "must be followed")
        self.check_plain("@test\n", "@test\n@test\n", 5, "must be followed")
        self.check_plain("end module", "@test\nend module", 9, "must be followed")
        self.check_plain("end module test_thing", "end", 9, "ends with 'end module test_thing'")
        self.check_plain("end module test_thing\n", "end module test_thing\n@test\n", 10, "must be followed")

    def test_wrong_number_of_arguments(self):
        self.check_plain("test_a()\n", "test_a(this)\n", 5, "takes no arguments")
        self.check_case("test_a(this)\n", "test_a()\n", 13, "takes one argument")

    def test_names(self):
        self.check_plain("test_a", "test_" + "a"*40, 6, "at most 44")
        self.check_plain("end module", "@test\nsubroutine Test_A\nend subroutine\nend module", 10, "there twice")
        self.check_plain("end module", "subroutine run()\nend subroutine\nend module", 9, "'run' belongs")
        self.check_plain("implicit none\n", "implicit none\ninteger :: n, t(3)\n", 4, "'t' belongs")

    # the module

    def test_module_name(self):
        self.check(PLAIN, 1, "named like its file", name="test_other.pf")
        self.check_plain("module test_thing\n   use", "module test_thing ! comment\n   use", 1, "nothing else")
        self.check(PLAIN.replace("module test_thing", ""), 9, "module named like the file")
        self.check("", 1, "module named like the file")
        self.check_plain("end module test_thing\n", "end module\nmodule more\n", 10, "one module")

    def test_private_module(self):
        self.check_plain("implicit none\n", "implicit none\nprivate\n", 4, "stays public")

    def test_use_of_the_framework(self):
        self.check_plain("use funit", "use funit, only: assertEqual", 2, "without 'only'")
        self.check_plain("   use funit\n", "", 8, "is missing")
        self.check_plain("@test\n   subroutine test_a()", "@test(npes=[1])\n   subroutine test_a(this)", 9, "use pfunit")

    def test_file_without_tests(self):
        self.check_plain("@test\n", "\n", 9, "no @test")

    # fixtures

    def test_before_and_after(self):
        before = "@before\nsubroutine set_up()\nend subroutine\n"
        self.check_plain("   @test\n", before + before + "   @test\n", 9, "one @before")
        self.check_plain("   @test\n", before.replace("()", "(this)") + "   @test\n", 5, "no arguments")
        self.check_case("   @test\n", before + "   @test\n", 13, "no effect")

    def test_before_in_mpi_files(self):
        mpi = PLAIN.replace("use funit", "use pfunit").replace("@test\n", "@test(npes=[1])\n").replace("a()", "a(this)")
        before = "contains\n@before\nsubroutine set_up(this)\nend subroutine\n"
        both = before + "@after\nsubroutine clean(this)\nend subroutine\n"
        plain = "@test\nsubroutine test_b()\nend subroutine\nend module"
        self.check(mpi.replace("contains\n", before), 5, "both @before and @after")
        self.check(mpi.replace("contains\n", both).replace("end module", plain), 5, "all tests of the file")
        self.assertEqual(translate(mpi.replace("contains\n", both))[:2], (0, ""))

    def test_cases(self):
        self.check_case("ParameterizedTestCase", "my_base_t", 10, "extends one of")
        self.check_case("(ParameterizedTestCase)", "(TestCase)", 9, "extends ParameterizedTestCase")
        self.check_case("constructor=new_case, ", "", 9, "constructor=")
        self.check_case(", testParameters={[row_t()]}", "", 13, "no testParameters=")
        self.check_case("   @test\n", "   @test\n@disable\n", 13, "no effect")
        self.check_case("constructor=new_case,", "constructor=new_case, npes=[2],", 17, "use pfunit")
        self.check(CASE.replace("use funit", "use pfunit").replace("=new_case,", "=new_case, npes=[2],"), 9, "belong together")
        self.check_case("   @testCase(constructor=new_case, testParameters={[row_t()]})\n", "", 4, "without @testCase")
        self.check_plain("@test\n", "@test(testParameters={[1]})\n", 5, "needs a @testParameter")


if __name__ == "__main__":
    unittest.main()
