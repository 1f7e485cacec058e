!> Layout of a result file, known before the first point is solved, and the time of each rank by activity.
module hb_results_layout
   use hb_error, only: error_t, fail
   use hb_kinds, only: wp
   use hb_text, only: to_text
   implicit none
   private
   public :: check_layout, n_times, named_number_t, rank_times_t, results_layout_t, swept_parameter_t, times_of_row

   integer, parameter :: n_times = 8                                  ! numbers in a row of a table

   !> The activities of one rank between the first draw and the end of the run. The seconds of the parts add up to
   !> `total`, except for the time outside the parts.
   type :: rank_times_t
      integer :: n_points = 0
      integer :: n_draws = 0                                          !! numbers drawn from counters
      real(wp) :: reading = 0.0_wp                                    !! [s] creating models from the input
      real(wp) :: solving = 0.0_wp                                    !! [s]
      real(wp) :: writing = 0.0_wp                                    !! [s]
      real(wp) :: drawing = 0.0_wp                                    !! [s] waiting for counters and tallies
      real(wp) :: idle = 0.0_wp                                       !! [s] waiting for the other ranks at the end
      real(wp) :: total = 0.0_wp                                      !! [s]
   contains
      procedure :: as_row => rank_times_as_row
      procedure :: overhead_per_point => rank_times_overhead_per_point
   end type rank_times_t

   !> One swept input parameter with its value at each point.
   type :: swept_parameter_t
      character(:), allocatable :: path                 !! in the input, for example `law(1)%gap`
      character(:), allocatable :: units                !! of the input
      logical :: is_text = .false.                      !! which of the next two components contains the values
      real(wp), allocatable :: values(:)                !! (n_points)
      character(64), allocatable :: text_values(:)      !! (n_points)
   end type swept_parameter_t

   !> A root attribute of what a whole run has found.
   type :: named_number_t
      character(32) :: name = ""
      real(wp) :: value = 0.0_wp
   end type named_number_t

   !> The data of a file that are known before the first point is solved; the same on all ranks.
   type :: results_layout_t
      integer :: n_points = 0
      character(:), allocatable :: curve_parameter      !! path of the value that moves along curves; none: there are no curves
      character(:), allocatable :: curve_units          !! of the value
      integer :: n_curve_unknowns = 0                   !! largest number of unknowns of a curve
      integer, allocatable :: tuples(:, :)              !! (n_tones, n_harmonics), the union over all points; zeros if each
                                                        !! point has its own tuples
      logical :: has_own_tuples = .false.               !! each point has its own, in its first n_harmonics elements
      character(64), allocatable :: output_names(:)     !! to which a tolerance applies; none: to the motion
      character(64), allocatable :: gradient_names(:)   !! of values with respect to which motions are differentiated
      logical :: has_response_gradient = .false.        !! derivatives of one response in place of those of coefficients
      logical :: has_accuracy = .false.                 !! sets or grids are chosen for a tolerance
      character(16), allocatable :: dof_labels(:), dof_units(:) !! stored degrees of freedom; `m`, `rad`
      character(16), allocatable :: law_dof_labels(:), law_dof_units(:) !! those with laws
      character(64), allocatable :: law_labels(:)       !! of the laws, unique
      integer :: n_multipliers = 0                      !! stored for each point; 0: stability is not requested
      logical :: has_improved = .false.                 !! improved coefficients are stored
      logical :: has_noise = .false.                    !! the response to noise is stored
      logical :: has_noise_spectrum = .false.           !! with its spectral density at a frequency
      integer, allocatable :: n_samples(:)              !! grid per tone; size 0: no surfaces are stored
      type(swept_parameter_t), allocatable :: parameters(:)
      type(named_number_t), allocatable :: numbers(:)   !! further root attributes, if there are any
      character(:), allocatable :: title
      character(:), allocatable :: input_name           !! name of the input file, for messages
      character(:), allocatable :: input_folder         !! absolute folder of files that the input names, with a slash at its end
      character(:), allocatable :: input_text           !! the input as given
      character(:), allocatable :: input_overrides      !! changes of it: path=value, one per line
      character(:), allocatable :: input_complete       !! the input after defaults
      character(:), allocatable :: input_libraries      !! of laws of the user, with their checksums, one per line
      integer :: n_ranks = 1
      character(:), allocatable :: program_version
      character(:), allocatable :: git_commit
   contains
      procedure :: forget_values => results_layout_forget_values
   end type results_layout_t

contains

   !> Frees the memory of the swept values after they are written to the file.
   pure subroutine results_layout_forget_values(self)
      class(results_layout_t), intent(inout) :: self
      integer :: i

      do i = 1, size(self%parameters)
         if (allocated(self%parameters(i)%values)) deallocate (self%parameters(i)%values)
         if (allocated(self%parameters(i)%text_values)) deallocate (self%parameters(i)%text_values)
      end do
   end subroutine results_layout_forget_values

   !> Rejects a layout with missing or inconsistent parts.
   subroutine check_layout(layout, error)
      type(results_layout_t), intent(in) :: layout
      type(error_t), allocatable, intent(out) :: error
      integer :: i

      if (.not. (allocated(layout%tuples) .and. allocated(layout%dof_labels) .and. &
                 allocated(layout%dof_units) .and. allocated(layout%law_dof_labels) .and. &
                 allocated(layout%law_labels) .and. allocated(layout%output_names) .and. allocated(layout%gradient_names) .and. &
                 allocated(layout%law_dof_units) .and. allocated(layout%n_samples) .and. &
                 allocated(layout%parameters))) then
         call fail(error, "layout: an array is not allocated")
      else if (layout%n_points < 1 .or. size(layout%tuples) < 1) then
         call fail(error, "layout: at least one point, one tone and one harmonic are needed")
      else if (size(layout%dof_units) /= size(layout%dof_labels) .or. &
               size(layout%law_dof_units) /= size(layout%law_dof_labels)) then
         call fail(error, "layout: labels and units of the degrees of freedom differ in number")
      else if (all(size(layout%n_samples) /= [0, size(layout%tuples, 1)]) .or. any(layout%n_samples < 1)) then
         call fail(error, "layout: the grid of surfaces needs a positive size for each tone, or no size")
      else
         do i = 1, size(layout%parameters)
            call check_parameter(layout%parameters(i), layout%n_points, error)
            if (allocated(error)) return
         end do
      end if
   end subroutine check_layout

   subroutine check_parameter(parameter, n_points, error)
      type(swept_parameter_t), intent(in) :: parameter
      integer, intent(in) :: n_points
      type(error_t), allocatable, intent(out) :: error
      integer :: n_values

      if (.not. allocated(parameter%path)) then
         call fail(error, "layout: a swept parameter has no path")
         return
      end if
      n_values = 0
      if (parameter%is_text .and. allocated(parameter%text_values)) n_values = size(parameter%text_values)
      if (.not. parameter%is_text .and. allocated(parameter%values)) n_values = size(parameter%values)
      if (n_values /= n_points) call fail(error, "layout: swept parameter '"//parameter%path//"' has "// &
                                          to_text(n_values)//" values for "//to_text(n_points)//" points")
   end subroutine check_parameter

   !> Seconds per point that are neither solving nor waiting; 0 without points.
   pure real(wp) function rank_times_overhead_per_point(self)
      class(rank_times_t), intent(in) :: self

      rank_times_overhead_per_point = 0.0_wp
      if (self%n_points > 0) rank_times_overhead_per_point = (self%total - self%solving - self%idle)/self%n_points
   end function rank_times_overhead_per_point

   !> All components as real numbers, to be gathered.
   pure function rank_times_as_row(self) result(row)
      class(rank_times_t), intent(in) :: self
      real(wp) :: row(n_times)

      row = [real(self%n_points, wp), real(self%n_draws, wp), self%reading, self%solving, self%writing, self%drawing, &
             self%idle, self%total]
   end function rank_times_as_row

   !> The inverse of `as_row`.
   pure type(rank_times_t) function times_of_row(row)
      real(wp), intent(in) :: row(n_times)

      times_of_row = rank_times_t(nint(row(1)), nint(row(2)), row(3), row(4), row(5), row(6), row(7), row(8))
   end function times_of_row
end module hb_results_layout
