!> Columns along degrees of freedom have the units of these: what visitors of columns outside of files have in common.
module hb_column_units
   use hb_motion_columns, only: columns_t, find_shared_unit
   implicit none
   private
   public :: column_kind, columns_with_units_t

   type :: column_kind_t
      integer :: real = 0
      integer :: integer = 1
      integer :: unknown = 2                                          !! no value is known
      integer :: text = 3                                             !! hb_session has the only one, the message
   end type column_kind_t
   type(column_kind_t), parameter :: column_kind = column_kind_t()

   type, extends(columns_t), abstract :: columns_with_units_t
      integer :: structure_number = -1                                !! of the session, to which the units belong
      logical :: has_branch = .false.                                 !! motions are points of a sweep
      character(16), allocatable :: units_of_dof(:), units_of_law_dof(:), units_of_state_dof(:)   !! by the name of the axis
   contains
      procedure :: units_along => columns_with_units_units_along
   end type columns_with_units_t

contains

   !> Unit of a column, and the unit at each degree of freedom along it, separated by blanks; empty for other columns.
   subroutine columns_with_units_units_along(self, axes, given, units, dof_units)
      class(columns_with_units_t), intent(in) :: self
      character(*), intent(in) :: axes                                !! names, separated by blanks
      character(*), intent(in) :: given                               !! in the table of columns
      character(:), allocatable, intent(out) :: units, dof_units
      character(:), allocatable :: list
      character(16), allocatable :: units_of_axis(:)

      allocate (units_of_axis(0))
      if (index(" "//axes, " law_dof") > 0 .and. allocated(self%units_of_law_dof)) then
         units_of_axis = self%units_of_law_dof
      else if (index(axes, "state_dof") > 0 .and. allocated(self%units_of_state_dof)) then
         units_of_axis = self%units_of_state_dof
      else if (index(" "//axes, " dof") > 0 .and. allocated(self%units_of_dof)) then
         units_of_axis = self%units_of_dof
      end if
      call find_shared_unit(given, units_of_axis, units, list)
      dof_units = ""
      if (allocated(list)) dof_units = list
   end subroutine columns_with_units_units_along
end module hb_column_units
