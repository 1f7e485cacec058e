!> The result file of a run: the only writer of the schema in docs/schema.md.
!>
!> In the order of use: fill a `results_layout_t`, `create_results` or, to go on with a file, `open_results`, then
!> `write_point` by any rank for any point, then `close`. The file is made whole before the first point is solved;
!> after that only raw data are written in place, the status of a point last, so that a killed run leaves a sound
!> file in which a status other than 0 means complete.
module hb_results
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use hb_certificate, only: certificate_t
   use hb_error, only: annotate, error_t, fail
   use hb_hdf5, only: h5_file_t, open_file_parallel
   use hb_kinds, only: wp
   use hb_mpi, only: comm_t, rank_of, share_error
   use hb_outcome, only: outcome
   use hb_results_file, only: make_file
   use hb_results_layout, only: check_layout, results_layout_t, swept_parameter_t
   use hb_results_plan, only: is_characters, is_integer, is_real, message_length, new_plan, plan_t
   use hb_text, only: to_text
   implicit none
   private
   public :: create_results, open_results, point_result_t, results_layout_t, results_t, swept_parameter_t

   !> The result of one point. What is not allocated stays NaN in the file.
   type :: point_result_t
      integer :: status = outcome%pending               !! hb_outcome
      character(:), allocatable :: message              !! why the point failed; cut to 200 bytes
      integer :: iterations = 0
      integer :: evaluations = 0                        !! of the residual
      integer :: rescue = 0                             !! what the solver needed, hb_solver_types
      real(wp) :: residual = 0.0_wp                     !! relative to the scale of the forces
      real(wp) :: solve_seconds = 0.0_wp
      integer :: rank = 0                               !! that solved it
      integer :: n_harmonics = 0                        !! in the set of this point
      real(wp), allocatable :: frequency(:)             !! [rad/s], (n_tones)
      real(wp), allocatable :: coefficients(:, :, :)    !! (cos and sin, n_harmonics, n_dofs)
      real(wp), allocatable :: force_coefficients(:, :, :) !! [N], (cos and sin, n_harmonics, n_law_dofs)
      real(wp), allocatable :: corrected_coefficients(:, :, :) !! (cos and sin, n_harmonics, n_law_dofs)
      integer :: n_full_stick = 0                       !! friction laws that slip nowhere: one of many solutions
      type(certificate_t) :: certificate                !! zero and without combination where none was made
      logical :: is_near_commensurate = .false.
      real(wp), allocatable :: displacement_samples(:, :) !! (n_samples_total, n_law_dofs), tone 1 fastest
      real(wp), allocatable :: corrected_samples(:, :)  !! same
      real(wp), allocatable :: force_samples(:, :)      !! [N], same
   end type point_result_t

   !> A result file open for writing.
   type :: results_t
      private
      type(h5_file_t) :: file
      character(:), allocatable :: path
      type(plan_t) :: plan
      integer :: n_points = 0
      logical :: is_resumed = .false.                   !! rows may hold what a run before has left
   contains
      procedure :: close => results_close
      procedure :: write_point => results_write_point
   end type results_t

   !> Writes the row of one point; does nothing once there is an error, so that a point reads as a plain list.
   interface put
      module procedure put_integer
      module procedure put_real
   end interface put

contains

   !> Makes the result file and opens it on all ranks; collective, and an error is the same on all ranks.
   !>
   !> An existing file is an error unless `overwrite` is true. It is replaced only when the new file is
   !> complete: that is made under another name in the same folder.
   subroutine create_results(self, path, layout, overwrite, comm, error)
      type(results_t), intent(out) :: self
      character(*), intent(in) :: path
      type(results_layout_t), intent(in) :: layout
      logical, intent(in) :: overwrite
      type(comm_t), intent(in) :: comm
      type(error_t), allocatable, intent(out) :: error

      self%path = path
      call check_layout(layout, error)
      if (.not. allocated(error)) then
         self%n_points = layout%n_points
         call new_plan(self%plan, layout)
         if (rank_of(comm) == 0) call make_file(path, layout, self%plan, overwrite, error)
      end if
      call share_error(comm, error)
      if (.not. allocated(error)) call open_datasets(self, comm, error)
      call annotate(error, "result file '"//path//"'")
   end subroutine create_results

   !> Opens a file that a run before has made from the same layout, to write further points; collective, and an error is
   !> the same on all ranks.
   subroutine open_results(self, path, layout, comm, error)
      type(results_t), intent(out) :: self
      character(*), intent(in) :: path
      type(results_layout_t), intent(in) :: layout
      type(comm_t), intent(in) :: comm
      type(error_t), allocatable, intent(out) :: error

      self%path = path
      self%is_resumed = .true.
      call check_layout(layout, error)
      if (.not. allocated(error)) then
         self%n_points = layout%n_points
         call new_plan(self%plan, layout)
      end if
      call share_error(comm, error)
      if (.not. allocated(error)) call open_datasets(self, comm, error)
      call annotate(error, "result file '"//path//"'")
   end subroutine open_results

   !> Opens the file on all ranks; refuses datasets of other extents than those of the plan.
   subroutine open_datasets(self, comm, error)
      type(results_t), intent(inout) :: self
      type(comm_t), intent(in) :: comm
      type(error_t), allocatable, intent(out) :: error
      type(error_t), allocatable :: error_in_close
      integer :: i

      call open_file_parallel(self%file, self%path, comm, error)
      call share_error(comm, error)
      if (allocated(error)) return
      do i = 1, size(self%plan%variables)
         associate (variable => self%plan%variables(i))
            call self%file%open_dataset(variable%name, variable%dataset, error)
            if (allocated(error)) exit
            if (any(variable%dataset%get_extents() /= self%plan%axes(variable%axes)%length)) &
               call fail(error, "dataset '"//variable%name//"' has other extents than the input asks for")
         end associate
         if (allocated(error)) exit
      end do
      call share_error(comm, error)
      if (allocated(error)) call self%file%close(error_in_close)
   end subroutine open_datasets

   !> Writes the result of point `i`, from 1, the status last; any rank may write any point at any time.
   subroutine results_write_point(self, i, point, error)
      class(results_t), intent(inout) :: self
      integer, intent(in) :: i
      type(point_result_t), intent(in) :: point
      type(error_t), allocatable, intent(out) :: error

      if (i < 1 .or. i > self%n_points) then
         call fail(error, "result file '"//self%path//"': no point "//to_text(i)//", there are "// &
                   to_text(self%n_points))
         return
      end if
      if (self%is_resumed) call blank_row(self, i, error)
      call put_message(self, i, point%message, error)
      call put(self, "iterations", i, [point%iterations], error)
      call put(self, "rescue", i, [point%rescue], error)
      call put(self, "evaluations", i, [point%evaluations], error)
      call put(self, "residual", i, [point%residual], error)
      call put(self, "solve_seconds", i, [point%solve_seconds], error)
      call put(self, "rank", i, [point%rank], error)
      call put(self, "n_harmonics", i, [point%n_harmonics], error)
      call put(self, "n_full_stick", i, [point%n_full_stick], error)
      if (allocated(point%frequency)) call put(self, "frequency", i, point%frequency, error)
      if (allocated(point%coefficients)) call put(self, "coefficients", i, point%coefficients, error)
      if (allocated(point%force_coefficients)) call put(self, "force_coefficients", i, point%force_coefficients, error)
      if (allocated(point%corrected_coefficients)) call put(self, "corrected_coefficients", i, point%corrected_coefficients, error)
      if (allocated(point%certificate%combination)) call put_certificate(self, i, point, error)
      if (allocated(point%displacement_samples)) call put(self, "displacement_samples", i, point%displacement_samples, error)
      if (allocated(point%corrected_samples)) call put(self, "corrected_samples", i, point%corrected_samples, error)
      if (allocated(point%force_samples)) call put(self, "force_samples", i, point%force_samples, error)
      call put(self, "status", i, [point%status], error)
      call annotate(error, "point "//to_text(i))
   end subroutine results_write_point

   !> Brings the row of a point back to what it was when the file was made, the status first: a run that is killed between
   !> two lines leaves the point pending.
   subroutine blank_row(self, i, error)
      class(results_t), intent(inout) :: self
      integer, intent(in) :: i
      type(error_t), allocatable, intent(inout) :: error
      integer :: k, n

      call put(self, "status", i, [outcome%pending], error)
      do k = 1, size(self%plan%variables)
         if (allocated(error)) return
         associate (variable => self%plan%variables(k))
            n = product(self%plan%axes(variable%axes(:size(variable%axes) - 1))%length)
            select case (variable%kind)
            case (is_integer)
               call variable%dataset%write_row(i, spread(0, 1, n), error)
            case (is_real)
               call variable%dataset%write_row(i, spread(ieee_value(1.0_wp, ieee_quiet_nan), 1, n), error)
            case (is_characters)
               call variable%dataset%write_row(i, "", error)
            end select
         end associate
      end do
   end subroutine blank_row

   subroutine put_certificate(self, i, point, error)
      class(results_t), intent(inout) :: self
      integer, intent(in) :: i
      type(point_result_t), intent(in) :: point
      type(error_t), allocatable, intent(inout) :: error

      associate (found => point%certificate)
         call put(self, "truncation_estimate", i, [found%truncation], error)
         call put(self, "aliasing_estimate", i, [found%aliasing], error)
         call put(self, "penetration", i, [found%defects%penetration], error)
         call put(self, "tension", i, [found%defects%tension], error)
         call put(self, "complementarity", i, [found%defects%complementarity], error)
         call put(self, "slip_defect", i, [found%defects%slip], error)
         call put(self, "power_in", i, [found%power_in], error)
         call put(self, "power_damping", i, [found%power_damping], error)
         call put(self, "power_laws", i, found%power_laws, error)
         call put(self, "combination_frequency", i, [found%combination_frequency], error)
         call put(self, "combination", i, found%combination, error)
         call put(self, "is_near_commensurate", i, [merge(1, 0, point%is_near_commensurate)], error)
      end associate
   end subroutine put_certificate

   !> Closes the file; collective, safe to call twice.
   subroutine results_close(self, error)
      class(results_t), intent(inout) :: self
      type(error_t), allocatable, intent(out) :: error

      call self%file%close(error)
      call annotate(error, "result file '"//self%path//"'")
   end subroutine results_close

   subroutine put_integer(self, name, i, values, error)
      class(results_t), intent(inout) :: self
      character(*), intent(in) :: name
      integer, intent(in) :: i
      integer, intent(in), contiguous :: values(:)
      type(error_t), allocatable, intent(inout) :: error

      if (allocated(error)) return
      call self%plan%variables(index_of(self, name))%dataset%write_row(i, values, error)
   end subroutine put_integer

   subroutine put_real(self, name, i, values, error)
      class(results_t), intent(inout) :: self
      character(*), intent(in) :: name
      integer, intent(in) :: i
      real(wp), intent(in), contiguous :: values(..)
      type(error_t), allocatable, intent(inout) :: error
      integer :: j

      if (allocated(error)) return
      j = index_of(self, name)
      if (j == 0) then
         call fail(error, "'"//name//"' given, but the layout has no grid for surfaces")
         return
      end if
      call self%plan%variables(j)%dataset%write_row(i, values, error)
   end subroutine put_real

   subroutine put_message(self, i, message, error)
      class(results_t), intent(inout) :: self
      integer, intent(in) :: i
      character(*), intent(in), optional :: message    !! empty where it is not there
      type(error_t), allocatable, intent(inout) :: error
      character(:), allocatable :: text

      if (allocated(error)) return
      text = ""
      if (present(message)) text = message(:whole_length(message, message_length))
      call self%plan%variables(index_of(self, "message"))%dataset%write_row(i, text, error)
   end subroutine put_message

   !> Gives the index of the variable called `name`, 0 when the file has none.
   pure integer function index_of(self, name)
      class(results_t), intent(in) :: self
      character(*), intent(in) :: name

      do index_of = size(self%plan%variables), 1, -1
         if (self%plan%variables(index_of)%name == name) return
      end do
   end function index_of

   !> Gives the length to which a UTF-8 text can be cut without cutting a character.
   pure integer function whole_length(text, max_length)
      character(*), intent(in) :: text
      integer, intent(in) :: max_length

      whole_length = min(len(text), max_length)
      if (whole_length == len(text)) return
      do while (whole_length > 0 .and. iand(ichar(text(whole_length + 1:whole_length + 1)), 192) == 128)
         whole_length = whole_length - 1               ! the next byte continues a character
      end do
   end function whole_length
end module hb_results
