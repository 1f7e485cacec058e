!> Problems of an object, such as numbers that do not fit together. The caller decides what becomes of them: a reader adds
!> them to those of its group, others make an error of them.
module hb_problems
   use hb_error, only: error_t, fail
   implicit none
   private
   public :: problem_list_t, problems_t

   type, abstract :: problems_t
   contains
      procedure(add_problem), deferred :: add
   end type problems_t

   abstract interface
      !> Adds a problem with the number or option that has this key.
      subroutine add_problem(self, key, text)
         import :: problems_t
         class(problems_t), intent(inout) :: self
         character(*), intent(in) :: key
         character(*), intent(in) :: text                             !! what would be correct
      end subroutine add_problem
   end interface

   !> Problems as an error, one per line; not allocated without any.
   type, extends(problems_t) :: problem_list_t
      type(error_t), allocatable :: error
   contains
      procedure :: add => problem_list_add
   end type problem_list_t

contains

   subroutine problem_list_add(self, key, text)
      class(problem_list_t), intent(inout) :: self
      character(*), intent(in) :: key, text

      if (allocated(self%error)) then
         self%error%message = self%error%message//new_line("a")//key//": "//text
      else
         call fail(self%error, key//": "//text)
      end if
   end subroutine problem_list_add
end module hb_problems
