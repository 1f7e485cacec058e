!> What later steps read of the curves in a result file: the values along them, and the points at which other motions branch off.
module hb_curve_table
   use hb_error, only: error_t
   use hb_hdf5, only: h5_dataset_t, h5_file_t, open_file
   use hb_kinds, only: wp
   use hb_parameter_path, only: identifier
   use hb_point_kinds, only: beginning, curve_kinds
   use hb_sweep_plan, only: sweep_plan_t
   implicit none
   private
   public :: find_leaving, leaving_t, note_curve_values

   !> A point of a curve at which other motions branch off.
   type :: leaving_t
      integer :: point = 0                                            !! from 1
      integer :: kind = 0                                             !! hb_point_kinds%curve_kind
      integer :: beyond = 0                                           !! of a graze: the adjacent point, on the side of contact
   end type leaving_t

contains

   !> Stores in a plan the values of the points of curves in a file.
   subroutine note_curve_values(path, plan, error)
      character(*), intent(in) :: path
      type(sweep_plan_t), intent(inout) :: plan
      type(error_t), allocatable, intent(out) :: error
      type(h5_file_t) :: file
      type(h5_dataset_t) :: dataset

      if (.not. allocated(plan%curve)) return
      allocate (plan%curve_values(plan%n_points))
      call open_file(file, path, error)
      if (allocated(error)) return
      call file%open_dataset(identifier(plan%curve%path), dataset, error)
      if (.not. allocated(error)) call dataset%get_attribute("units", plan%curve%units, error)
      if (.not. allocated(error)) call dataset%read(plan%curve_values, error)
      if (allocated(plan%curve%over)) call file%get("curve_over", plan%over_values, error, [plan%n_points])
      call file%close(error)
   end subroutine note_curve_values

   !> Lists the points at which other motions branch off the curves of a file: period doublings, torus bifurcations,
   !> and grazes with a loss of stability.
   subroutine find_leaving(path, n_points, leaving, error)
      character(*), intent(in) :: path
      integer, intent(in) :: n_points
      type(leaving_t), allocatable, intent(out) :: leaving(:)
      type(error_t), allocatable, intent(out) :: error
      type(h5_file_t) :: file
      integer, allocatable :: is_stable(:), kind(:)
      integer :: after, before, beyond, i

      allocate (leaving(0))
      call open_file(file, path, error)
      if (allocated(error)) return
      call file%get("curve_kind", kind, error, [n_points])
      call file%get("is_stable", is_stable, error, [n_points])
      call file%close(error)
      if (allocated(error)) return
      do i = 1, n_points
         beyond = i
         if (curve_kinds(kind(i))%multipliers_jump) then
            before = max(1, i - 1)
            after = min(n_points, i + 1)
            if (is_stable(before) > 0 .and. is_stable(after) < 0) beyond = after
            if (is_stable(before) < 0 .and. is_stable(after) > 0) beyond = before
         end if
         if (curve_kinds(kind(i))%begins == beginning%nothing) cycle
         if (beyond /= i .or. .not. curve_kinds(kind(i))%multipliers_jump) leaving = [leaving, leaving_t(i, kind(i), beyond)]
      end do
   end subroutine find_leaving
end module hb_curve_table
