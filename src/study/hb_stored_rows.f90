!> Columns of a result file of any origin: each must have the dimensions of the table of columns, with the lengths of
!> the scales of the file.
module hb_stored_rows
   use hb_error, only: error_t
   use hb_hdf5, only: h5_dataset_t, h5_file_t
   use hb_kinds, only: wp
   use hb_motion_result, only: curve_position_t
   use hb_result_columns, only: new_plan, plan_t
   use hb_results_layout, only: results_layout_t
   implicit none
   private
   public :: stored_file_t

   !> An open file and its columns.
   type :: stored_file_t
      type(h5_file_t) :: file
      type(plan_t) :: plan
   contains
      generic :: fetch => fetch_integers, fetch_reals
      procedure :: get_position => stored_file_get_position
      procedure :: get_tuples => stored_file_get_tuples
      procedure :: list => stored_file_list
      procedure, private :: fetch_integers => stored_file_fetch_integers
      procedure, private :: fetch_reals => stored_file_fetch_reals
   end type stored_file_t

contains

   !> Lists all columns that a file may have, with the dimensions of this one.
   subroutine stored_file_list(self, error)
      class(stored_file_t), intent(inout) :: self
      type(error_t), allocatable, intent(inout) :: error
      type(results_layout_t) :: layout
      type(h5_dataset_t) :: scale
      integer :: i

      if (allocated(error)) return
      layout%tuples = reshape([0], [1, 1])
      layout%has_accuracy = .true.
      layout%has_own_tuples = .true.
      layout%n_multipliers = 1
      layout%curve_parameter = ""
      allocate (layout%dof_labels(0), layout%dof_units(0), layout%law_dof_labels(0), layout%law_dof_units(0))
      allocate (layout%law_labels(0), layout%output_names(1), layout%gradient_names(1), layout%n_samples(0))
      layout%has_noise = self%file%has("noise_status")
      layout%has_noise_spectrum = self%file%has("noise_spectrum")
      layout%has_response_gradient = self%file%has("response_gradient")
      call new_plan(self%plan, layout)
      do i = 1, size(self%plan%axes)
         associate (axis => self%plan%axes(i))
            axis%length = 0
            if (.not. self%file%has(axis%name)) cycle
            call self%file%open_dataset(axis%name, scale, error)
            if (allocated(error)) return
            axis%length = product(scale%get_extents())
            call scale%close()
         end associate
      end do
   end subroutine stored_file_list

   !> Reads the values of a column, or those of one point, in the order of the file; no effect after an error.
   subroutine stored_file_fetch_integers(self, name, values, error, point)
      class(stored_file_t), intent(in) :: self
      character(*), intent(in) :: name
      integer, allocatable, intent(out) :: values(:)
      type(error_t), allocatable, intent(inout) :: error
      integer, intent(in), optional :: point                          !! from 1

      if (allocated(error)) return                                    ! the columns are perhaps not listed
      call self%file%get(name, values, error, self%plan%extents_of(self%plan%columns(self%plan%index_of(name))), point)
   end subroutine stored_file_fetch_integers

   !> As for integers.
   subroutine stored_file_fetch_reals(self, name, values, error, point)
      class(stored_file_t), intent(in) :: self
      character(*), intent(in) :: name
      real(wp), allocatable, intent(out) :: values(:)
      type(error_t), allocatable, intent(inout) :: error
      integer, intent(in), optional :: point                          !! from 1

      if (allocated(error)) return                                    ! the columns are perhaps not listed
      call self%file%get(name, values, error, self%plan%extents_of(self%plan%columns(self%plan%index_of(name))), point)
   end subroutine stored_file_fetch_reals

   !> Reads the tuples of a point: its own, or those of the file; no effect after an error.
   subroutine stored_file_get_tuples(self, point, tuples, error)
      class(stored_file_t), intent(in) :: self
      integer, intent(in) :: point                                    !! from 1
      integer, allocatable, intent(out) :: tuples(:, :)               !! (n_tones, n_harmonics)
      type(error_t), allocatable, intent(inout) :: error
      integer, allocatable :: n_harmonics(:), values(:)
      integer :: n

      if (allocated(error)) return
      n = self%plan%length_of("harmonic")
      if (self%file%has("tuples")) then
         call self%fetch("tuples", values, error, point)
         call self%fetch("n_harmonics", n_harmonics, error, point)
         if (.not. allocated(error)) n = max(1, min(n_harmonics(1), n))
      else
         call self%file%get("tuple", values, error, [self%plan%length_of("tone"), n])
      end if
      if (.not. allocated(error)) tuples = reshape(values, [self%plan%length_of("tone"), n])
   end subroutine stored_file_get_tuples

   !> Reads the position of a point on its curve; if it is on no curve, only this information. No effect after an error.
   subroutine stored_file_get_position(self, point, position, error, parameter)
      class(stored_file_t), intent(in) :: self
      integer, intent(in) :: point                                    !! from 1
      type(curve_position_t), intent(out) :: position
      type(error_t), allocatable, intent(inout) :: error
      character(*), intent(in), optional :: parameter                 !! column of the value that moves along the curve
      real(wp), allocatable :: value(:)
      integer :: n

      if (allocated(error)) return
      value = [0.0_wp]
      if (present(parameter)) call self%file%get(parameter, value, error, [self%plan%length_of("point")], point)
      if (allocated(error)) return
      position = curve_position_t(whole("curve_kind"), value(1), number("curve_length"), whole("curve_branch"))
      if (position%kind == 0 .or. allocated(error)) return
      n = whole("curve_n_unknowns")
      call self%fetch("curve_unknowns", position%unknowns, error, point)
      call self%fetch("curve_direction", position%direction, error, point)
      position%step = number("curve_step")
      position%orientation = number("curve_orientation")
      position%largest_motion = number("curve_largest_motion")
      position%n_unreliable = whole("curve_unreliable_steps")
      position%n_exhausted = whole("curve_exhausted_steps")
      position%angle = number("curve_angle")
      position%over = number("curve_over")
      position%response = whole("curve_response")
      position%extreme = whole("curve_extreme")
      if (allocated(error)) return
      n = max(0, min(n, size(position%unknowns)))
      position%unknowns = position%unknowns(:n)
      position%direction = position%direction(:n)
      if (self%file%has("grid")) call self%fetch("grid", position%n_samples, error, point)
      if (self%file%has("tuples")) call self%get_tuples(point, position%tuples, error)

   contains

      integer function whole(name)
         character(*), intent(in) :: name
         integer, allocatable :: values(:)

         whole = 0
         call self%fetch(name, values, error, point)
         if (.not. allocated(error)) whole = values(1)
      end function whole

      real(wp) function number(name)
         character(*), intent(in) :: name
         real(wp), allocatable :: values(:)

         number = 0.0_wp
         call self%fetch(name, values, error, point)
         if (.not. allocated(error)) number = values(1)
      end function number
   end subroutine stored_file_get_position
end module hb_stored_rows
