!> The course of one branch of a curve of motions: its folds, its last steps, and what follows from them: whether it has come back
!> to a fold, and whether its tones lock ahead. A torus ends at a saddle-node of periodic motions where its tones lock: the
!> frequency f of a combination of the tones vanishes there as the square root of the distance, so that f**2 is a linear
!> function of the value of the curve; where the tones are commensurate without locking, f itself is one. Source: Guckenheimer
!> and Holmes, Nonlinear Oscillations, Dynamical Systems, and Bifurcations of Vector Fields (1983), sections 2.1 and 3.4.
module hb_curve_course
   use hb_curve_points, only: reported_extreme_t
   use hb_error_estimate, only: near_commensurate
   use hb_kinds, only: wp
   use hb_level, only: estimate_of, estimate_of_motion, level_t, without_motion
   use hb_motion_result, only: motion_result_t
   use hb_options, only: accuracy_t
   use hb_outcome, only: outcome
   use hb_thresholds, only: max_reliable_error
   use hb_tones, only: tones_t
   implicit none
   private
   public :: curve_course_t, max_exhausted, max_unlocated, max_unreliable

   integer, parameter :: max_unreliable = 30                          !! consecutive steps with errors too large to be estimated
   integer, parameter :: max_exhausted = 10                           !! consecutive steps that use up the work of a point
   integer, parameter :: max_unlocated = 10                           !! consecutive folds that are not located, near each other
   real(wp), parameter :: max_span = 0.01_wp                          ! of the arc with these
   real(wp), parameter :: max_error_ratio = 10.0_wp                         ! in units of the tolerance: too large to go on
   integer, parameter :: n_points = 4                                 ! from which the frequency of a combination is extrapolated
   real(wp), parameter :: min_decrease = 1.5_wp                       ! of it over these points
   real(wp), parameter :: max_slope_change = 0.15_wp                  ! largest relative change of the slope of a straight line

   !> A fold that the branch has passed.
   type :: passed_fold_t
      real(wp), allocatable :: x(:)                                   !! its unknowns
      type(level_t) :: level                                          !! its set and grid
      real(wp) :: length = 0.0_wp                                     !! of the arc up to there
   end type passed_fold_t

   !> The points of one branch so far.
   type :: curve_course_t
      type(passed_fold_t), allocatable :: folds(:)
      logical :: is_retraced = .false.                                !! the branch has come back to one of them
      integer, allocatable :: locked(:)                               !! combination of tones that vanishes ahead, if any
      real(wp) :: locked_at = 0.0_wp                                  !! value where it does
      type(reported_extreme_t), allocatable :: reported(:)
      integer :: n_unreliable = 0                                     !! last steps whose errors are not known
      integer :: n_exhausted = 0                                      !! last steps that took the work of a point
      real(wp), allocatable, private :: values(:)                     ! of the last ends of steps
      real(wp), allocatable, private :: omega(:, :)                   ! [rad/s], (n_tones, the last ends of steps)
   contains
      procedure :: begin => curve_course_begin
      procedure :: count_step => curve_course_count_step
      procedure :: is_circling => curve_course_is_circling
      procedure :: status => curve_course_status
      procedure :: add_fold => curve_course_add_fold
      procedure :: add_step => curve_course_add_step
      procedure :: find_locking => curve_course_find_locking
   end type curve_course_t

contains

   !> Begins a branch.
   pure subroutine curve_course_begin(self)
      class(curve_course_t), intent(inout) :: self

      self%folds = [passed_fold_t ::]
      self%reported = [reported_extreme_t ::]
      self%is_retraced = .false.
      if (allocated(self%locked)) deallocate (self%locked)
      self%n_unreliable = 0
      self%n_exhausted = 0
      self%values = [real(wp) ::]
      if (allocated(self%omega)) deallocate (self%omega)
   end subroutine curve_course_begin

   !> Counts the last steps whose errors are not known, or that have used up the work of a point.
   subroutine curve_course_count_step(self, requested, is_out_of_work, result)
      class(curve_course_t), intent(inout) :: self
      type(accuracy_t), intent(in) :: requested
      logical, intent(in) :: is_out_of_work                           !! the last step
      type(motion_result_t), intent(in) :: result                     !! at its end

      self%n_unreliable = merge(self%n_unreliable + 1, 0, is_unreliable(estimate_of_motion(result), requested))
      self%n_exhausted = merge(self%n_exhausted + 1, 0, is_out_of_work .and. estimate_of(result) > requested%tolerance)
   end subroutine curve_course_count_step

   !> Whether an estimated error has no meaning, except that it is large: at a given order. By a tolerance, whether it is far above
   !> that.
   pure logical function is_unreliable(estimate, accuracy)
      real(wp), intent(in) :: estimate
      type(accuracy_t), intent(in) :: accuracy

      is_unreliable = estimate >= max_reliable_error
      if (accuracy%is_on .and. accuracy%grows_set) &
         is_unreliable = estimate >= min(max_error_ratio*accuracy%tolerance, max_reliable_error)
   end function is_unreliable

   !> How the branch ends if nothing is gained by a further step; otherwise pending.
   pure integer function curve_course_status(self) result(status)
      class(curve_course_t), intent(in) :: self

      status = outcome%pending
      if (allocated(self%locked)) status = outcome%locked
      if (self%n_unreliable >= max_unreliable .or. self%n_exhausted >= max_exhausted .or. self%is_circling()) &
         status = outcome%out_of_budget
   end function curve_course_status

   !> Whether the last folds of the branch were passed near each other without being located: between kinks of a law that are
   !> closer than any step the branch moves back and forth, or in a circle.
   pure logical function curve_course_is_circling(self) result(is_circling)
      class(curve_course_t), intent(in) :: self
      integer :: i, n

      n = 0
      is_circling = .false.
      if (.not. allocated(self%reported)) return
      do i = size(self%reported), 1, -1
         associate (fold => self%reported(i))
            if (fold%response /= 0) cycle
            if (abs(fold%sense) > 0.0_wp .or. self%reported(size(self%reported))%length - fold%length > max_span) return
         end associate
         n = n + 1
         is_circling = n >= max_unlocated
         if (is_circling) return
      end do
   end function curve_course_is_circling

   !> Adds a fold.
   subroutine curve_course_add_fold(self, x, level, length)
      class(curve_course_t), intent(inout) :: self
      real(wp), intent(in) :: x(:)                                    !! its unknowns
      type(level_t), intent(in) :: level                              !! its set and grid
      real(wp), intent(in) :: length                                  !! of the arc up to there
      type(passed_fold_t) :: fold                                     ! gfortran 12 leaks components of a constructor in a list

      fold%x = x
      fold%level = without_motion(level)
      fold%length = length
      self%folds = [self%folds, fold]
   end subroutine curve_course_add_fold

   !> Adds the end of a step.
   pure subroutine curve_course_add_step(self, value, omega)
      class(curve_course_t), intent(inout) :: self
      real(wp), intent(in) :: value
      real(wp), intent(in) :: omega(:)                                !! [rad/s], (n_tones)
      integer :: first

      if (.not. allocated(self%omega)) allocate (self%omega(size(omega), 0))
      first = max(1, size(self%values) - n_points + 2)
      self%values = [self%values(first:), value]
      self%omega = reshape([self%omega(:, first:), omega], [size(omega), size(self%values)])
   end subroutine curve_course_add_step

   !> Finds whether the tones lock ahead: the frequency of a combination is small and its square extrapolates to zero.
   subroutine curve_course_find_locking(self, tones, largest_frequency)
      class(curve_course_t), intent(inout) :: self
      type(tones_t), intent(in) :: tones                              !! of the curve; the frequencies are not used
      real(wp), intent(in) :: largest_frequency                       !! of a combination that nearly vanishes, relative to a tone
      integer, allocatable :: combination(:)
      type(tones_t) :: here
      real(wp) :: f(n_points), frequency, slopes(n_points - 1)

      if (tones%n_tones < 2 .or. size(self%values) < n_points) return
      here = tones
      here%omega = self%omega(:, n_points)
      call near_commensurate(here, combination, frequency)
      if (frequency > largest_frequency*maxval(abs(here%omega))) return
      f = matmul(real(combination, wp), self%omega)
      associate (p => self%values, m => n_points)
         if (any(f(2:)*f(:m - 1) <= 0.0_wp) .or. any(abs(f(2:)) >= abs(f(:m - 1)))) return
         if (abs(f(1)) < min_decrease*abs(f(m))) return
         if (any((p(2:) - p(:m - 1))*(p(m) - p(1)) <= 0.0_wp)) return
         slopes = (f(2:)**2 - f(:m - 1)**2)/(p(2:) - p(:m - 1))
         if (maxval(abs(slopes)) > (1.0_wp + max_slope_change)*minval(abs(slopes))) return
         self%locked_at = p(m) - f(m)**2/slopes(m - 1)
         call move_alloc(combination, self%locked)
      end associate
   end subroutine curve_course_find_locking
end module hb_curve_course
