!> Whether the points of a chain lie on one branch of motions. If a point is not on the extrapolation of its
!> predecessors, the branch of the last one is followed up to it in small steps, hb_branch_tracking; the outcome
!> becomes the message of the point. If points choose their own sets, the branch is followed in a set that has the
!> tuples of both points, in which both motions are computed again: a difference between the sets is thus not taken
!> for another branch.
!> The work is bounded: for all motions in between by the work of the points of the chain so far plus a fraction of a
!> second.
module hb_chain_check
   use hb_branch_tracking, only: difference_of, find_branch, finding, smallest_jump, stretch_t, tracking_t
   use hb_cancellation, only: work_is_over
   use hb_discretisation, only: discretisation_t
   use hb_error, only: error_t
   use hb_harmonics, only: harmonics_t
   use hb_kinds, only: wp
   use hb_level, only: check_discretisation, join, level_t, transferred
   use hb_model_reader, only: update_model
   use hb_motion, only: solve_system
   use hb_motion_result, only: motion_result_t
   use hb_options, only: options_t
   use hb_point_source, only: point_source_t
   use hb_stability, only: stability_method
   use hb_thresholds, only: max_distance_of_same
   implicit none
   private
   public :: chain_check_t

   integer, parameter :: max_motions = 120                           ! computed for a point
   real(wp), parameter :: free_work = 0.03e9_wp                       ! of a chain, as `work` of a result
   integer, parameter :: max_iterations = 10                         ! for one motion, from a close first guess
   real(wp), parameter :: largest_turn = 0.5_wp                       ! of an accepted step, relative to its length
   real(wp), parameter :: largest_first = 0.2_wp                      ! first step of a chain, relative to the motion

   !> The solved points of a chain so far.
   type :: chain_check_t
      private
      integer :: last_point = 0                                       ! 0: none
      real(wp) :: work_left = free_work
      real(wp) :: last_value = 0.0_wp
      type(level_t) :: last                                           ! set, grid and unknowns
      type(harmonics_t) :: slope_set
      real(wp), allocatable :: slope(:)                               ! of the coefficients; not allocated: not known
   contains
      procedure :: examine => chain_check_examine
   end type chain_check_t

   !> The interval between two points of a sweep.
   type, extends(stretch_t) :: swept_stretch_t
      type(point_source_t), pointer :: source => null()
      integer :: first = 0, last = 0                                  ! points
      integer :: n_left = max_motions
      real(wp) :: work_left = 0.0_wp
      type(level_t) :: level                                          ! set and grid, if points choose them
      real(wp), allocatable :: frequencies(:)                         ! appended to the coefficients of a guess
   contains
      procedure :: solve => swept_stretch_solve
   end type swept_stretch_t

contains

   !> Examines a solved point, which follows the last examined one. Afterwards the document and the model may have
   !> values between the two.
   subroutine chain_check_examine(self, source, point, here, result)
      class(chain_check_t), intent(inout) :: self
      type(point_source_t), intent(inout), target :: source
      integer, intent(in) :: point
      type(level_t), intent(in) :: here                               !! set, grid and unknowns of the point
      type(motion_result_t), intent(inout) :: result                  !! of the point; receives the message
      type(level_t) :: both
      type(swept_stretch_t) :: stretch
      type(tracking_t) :: tracking
      character(:), allocatable :: location
      real(wp), allocatable :: last(:), motion(:), slope(:)
      real(wp) :: length
      logical :: is_comparable, is_joined

      self%work_left = self%work_left + result%work
      both = here
      is_comparable = self%last_point > 0
      if (is_comparable) then
         is_comparable = n_functions(here) == n_functions(self%last)
         if (source%layout%has_own_tuples) then
            call join(both, self%last%harmonics, is_joined)
         else
            is_comparable = is_comparable .and. here%harmonics%equal(self%last%harmonics)
         end if
      end if
      if (is_comparable) then
         motion = coefficients_of(both, both%harmonics)
         last = coefficients_of(self%last, both%harmonics)
         if (allocated(self%slope)) slope = transferred(self%slope_set, both%harmonics, self%slope, 0)
         length = source%plan%fastest_value(point) - self%last_value
         if (is_doubtful(last, motion, length, slope) .and. self%work_left > 0.0_wp) then
            stretch%source => source
            stretch%first = self%last_point
            stretch%last = point
            stretch%frequencies = both%unknowns(size(motion) + 1:)
            stretch%work_left = self%work_left
            stretch%level = both
            if (allocated(self%last%torus%n_samples)) &
               call stretch%level%torus%resample(max(both%torus%n_samples, self%last%torus%n_samples))
            if (source%layout%has_own_tuples) then
               call find_anew(stretch, 0.0_wp, last)
               call find_anew(stretch, 1.0_wp, motion)
            end if
            call find_branch(stretch, last, motion, tracking)
            self%work_left = stretch%work_left
            call source%plan%describe_between(self%last_point, point, tracking%share, location)
            call describe(tracking, location, result)
         end if
         if (allocated(self%slope)) deallocate (self%slope)
         if (.not. result%leaves_branch) then
            self%slope = (coefficients_of(both, both%harmonics) - coefficients_of(self%last, both%harmonics))/length
            self%slope_set = both%harmonics
         end if
      else if (allocated(self%slope)) then
         deallocate (self%slope)
      end if
      self%last = here
      self%last_value = source%plan%fastest_value(point)
      self%last_point = point
   end subroutine chain_check_examine

   !> Computes the motion at one end of the interval in its set; it is unchanged if the result is a different one.
   subroutine find_anew(stretch, share, motion)
      type(swept_stretch_t), intent(inout) :: stretch
      real(wp), intent(in) :: share
      real(wp), intent(inout) :: motion(:)
      real(wp) :: found(size(motion))
      logical :: is_solved

      found = motion
      call stretch%solve(share, found, is_solved)
      if (is_solved) is_solved = difference_of(found, motion) <= max_distance_of_same
      if (is_solved) motion = found
   end subroutine find_anew

   !> Coefficients of a motion in another set.
   pure function coefficients_of(level, set) result(coefficients)
      type(level_t), intent(in) :: level
      type(harmonics_t), intent(in) :: set
      real(wp), allocatable :: coefficients(:)

      coefficients = transferred(level%harmonics, set, level%unknowns(:size(level%unknowns) - set%n_tones), 0)
   end function coefficients_of

   !> Number of coordinates of the laws of a motion.
   pure integer function n_functions(level)
      type(level_t), intent(in) :: level

      n_functions = (size(level%unknowns) - level%harmonics%n_tones)/level%harmonics%n_coefficients
   end function n_functions

   !> Whether a point deviates from the extrapolation of its predecessors.
   pure logical function is_doubtful(last, motion, length, slope)
      real(wp), intent(in) :: last(:), motion(:)                      !! in one set
      real(wp), intent(in) :: length                                  !! of the step in the parameter
      real(wp), allocatable, intent(in) :: slope(:)                   !! not allocated: not known

      is_doubtful = difference_of(motion, last) > smallest_jump
      if (.not. is_doubtful) return
      if (allocated(slope)) then
         is_doubtful = norm2(motion - last - length*slope) > largest_turn*norm2(motion - last)
      else
         is_doubtful = difference_of(motion, last) > largest_first
      end if
   end function is_doubtful

   !> Describes the outcome if there is one to report.
   subroutine describe(tracking, location, result)
      type(tracking_t), intent(in) :: tracking
      character(*), intent(in) :: location                            !! position at which the tracking ended
      type(motion_result_t), intent(inout) :: result
      character(:), allocatable :: text

      select case (tracking%finding)
      case (finding%ends)
         text = "not on the branch of the previous point, which ends near "//location
      case (finding%goes_on)
         text = "not on the branch of the previous point, which continues here with another motion"
      case default
         return
      end select
      result%leaves_branch = .true.
      call result%add_message(text, is_first=.false.)
   end subroutine describe

   !> Computes the motion of the model between two points, without further results.
   subroutine swept_stretch_solve(self, share, motion, is_solved)
      class(swept_stretch_t), intent(inout) :: self
      real(wp), intent(in) :: share
      real(wp), intent(inout) :: motion(:)
      logical, intent(out) :: is_solved
      type(error_t), allocatable :: error
      type(motion_result_t) :: result
      type(discretisation_t) :: discretisation
      type(options_t) :: bare
      real(wp), allocatable :: guess(:), unknowns(:)
      logical :: is_new

      is_solved = .false.
      call self%source%plan%apply_between(self%first, self%last, share, self%source%document)
      call update_model(self%source%model, self%source%document, is_new, error, self%source%available_memory)
      if (allocated(error)) return
      bare = self%source%model%options
      discretisation = self%source%model%discretisation
      if (self%source%layout%has_own_tuples) then
         discretisation%harmonics = self%level%harmonics
         call discretisation%torus%resample(self%level%torus%n_samples)
         call check_discretisation(self%source%model%system, discretisation, bare, error)
      end if
      if (allocated(error)) return
      bare%may_integrate = .false.
      bare%solver%fallback = .false.
      bare%solver%max_iterations = min(max_iterations, bare%solver%max_iterations)
      bare%error_estimate%is_on = .false.
      bare%stability%method = stability_method%off
      bare%output%samples = [integer ::]
      guess = [motion, self%frequencies]
      associate (system => self%source%model%system)
         system%contact_parts => self%source%cached%contact_parts(system%structure)
      end associate
      call solve_system(self%source%model%system, discretisation, bare, result, error, guess, unknowns)
      self%n_left = self%n_left - 1
      self%work_left = self%work_left - result%work
      self%is_spent = self%n_left == 0 .or. self%work_left <= 0.0_wp .or. work_is_over()
      if (allocated(error) .or. .not. allocated(unknowns)) return
      motion = unknowns(:size(motion))
      is_solved = .true.
   end subroutine swept_stretch_solve
end module hb_chain_check
