!> Motions apart from all curves followed so far, at the values that the input gives: each starts a curve of its own.
module hb_motions_apart
   use hb_bordered, only: bordered_problem_t, new_bordered_problem
   use hb_curve_sets, only: settle
   use hb_error, only: error_t
   use hb_followed_motion, only: followed_motion_t, origin_t
   use hb_kinds, only: two_pi, wp
   use hb_level, only: carry, join, level_t
   use hb_newton, only: solve_newton
   use hb_other_motions, only: find_other, is_other, shifted
   use hb_outcome, only: outcome
   use hb_solver_types, only: report_t, solver_config_t
   use hb_thresholds, only: safety
   implicit none
   private
   public :: look_apart

   integer, parameter :: most_iterations = 40                         ! from one guess
   integer, parameter :: most_spurious = 4                            ! motions at a value that a larger set makes known ones

contains

   !> Looks for a motion apart from all that were met at the values at which others are requested, and gives the first one.
   subroutine look_apart(self, met, x, is_found, error)
      class(followed_motion_t), intent(inout), target :: self
      type(origin_t), intent(in) :: met(:)                            !! motions at these values
      real(wp), allocatable, intent(out) :: x(:)                      !! on the set at hand
      logical, intent(out) :: is_found
      type(error_t), allocatable, intent(out) :: error
      type(origin_t), allocatable :: known(:), others(:)
      integer :: i, k, n_spurious

      is_found = .false.
      if (.not. allocated(self%request%others)) return
      do i = 1, size(self%request%others)
         known = pack(met, [(.not. abs(met(k)%x(size(met(k)%x)) - self%request%others(i)) > 0.0_wp, k=1, size(met))])
         if (size(known) == 0) cycle                                  ! nothing to begin with
         others = known
         do n_spurious = 0, most_spurious
            call look_at(self, self%request%others(i), others, x, is_found, error)
            if (allocated(error)) return
            if (.not. is_found) exit
            others = [others, origin_t(x=x, level=self%level)]
            call accept(self, known, x, is_found, error)
            if (allocated(error)) return
            if (is_found) return
         end do
      end do
   end subroutine look_apart

   !> Looks for a motion at a value beside those that are known there, on a set that has the tuples of all of them.
   subroutine look_at(self, value, known, x, is_found, error)
      class(followed_motion_t), intent(inout), target :: self
      real(wp), intent(in) :: value
      type(origin_t), intent(in) :: known(:)
      real(wp), allocatable, intent(out) :: x(:)
      logical, intent(out) :: is_found
      type(error_t), allocatable, intent(out) :: error
      type(bordered_problem_t) :: held
      type(report_t) :: report
      type(level_t) :: level
      type(solver_config_t) :: config
      real(wp), allocatable :: form(:, :), motions(:, :), solved(:)
      integer :: i
      logical :: is_new, is_possible

      is_found = .false.
      if (self%model%accuracy%is_on) then
         level = known(1)%level
         level%unknowns = [known(1)%x(:size(known(1)%x) - size(self%problem%which)), 0.0_wp*self%model%tones%omega]
         do i = 2, size(known)
            call join(level, known(i)%level%set, is_new)
            level%n_samples = max(level%n_samples, known(i)%level%n_samples)
         end do
         call self%put_on(level, error)
         if (allocated(error)) return
      end if
      motions = motions_of(self, known)
      call self%problem%move_to_point(motions(:, 1), is_possible)
      if (.not. is_possible) return
      allocate (form(size(motions, 1), 1), source=0.0_wp)
      form(size(form), 1) = 1.0_wp
      call new_bordered_problem(held, self%problem, self%problem%which, form, [value])
      config = self%problem%model%solver
      config%tolerance = max(config%tolerance, 2.0_wp*self%problem%rounding_level(motions(:self%problem%n_unknowns, 1)))
      config%max_iterations = most_iterations
      if (self%model%accuracy%is_on) then                             ! what is driven away from must be a zero of this problem
         do i = 1, size(motions, 2)
            solved = motions(:, i)
            call solve_newton(held, config, solved, report)
            if (report%status == outcome%converged) motions(:, i) = solved
         end do
      end if
      x = motions(:, 1)
      call find_other(held, config, self%problem%model%harmonics, motions, x, is_found)
      x(size(x)) = value
   end subroutine look_at

   !> Brings a motion to the tolerance; not accepted is one that is another then no more.
   subroutine accept(self, known, x, is_accepted, error)
      class(followed_motion_t), intent(inout), target :: self
      type(origin_t), intent(in) :: known(:)
      real(wp), allocatable, intent(inout) :: x(:)
      logical, intent(out) :: is_accepted
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: along(:)
      real(wp) :: value

      is_accepted = .true.
      if (.not. self%model%accuracy%is_on) return
      value = x(size(x))
      along = 0.0_wp*x
      along(size(x)) = 1.0_wp
      call settle(self, x, along, error)
      if (allocated(error)) return
      x(size(x)) = value
      is_accepted = is_other(x, motions_of(self, known), self%problem%model%harmonics, self%problem%x_scale, &
                             safety*self%model%accuracy%tolerance)
   end subroutine accept

   !> Motions on the set at hand, and the same ones shifted by periods of what drives them.
   function motions_of(self, known) result(motions)
      class(followed_motion_t), intent(in) :: self
      type(origin_t), intent(in) :: known(:)
      real(wp), allocatable :: motions(:, :)
      real(wp), allocatable :: phases(:)
      real(wp) :: x(self%problem%n_unknowns + 1)
      integer :: copy, i, m, n_copies

      associate (model => self%problem%model, n => self%problem%n_unknowns)
         n_copies = model%tones%subharmonic**model%tones%n_tones
         allocate (motions(n + 1, 0), phases(model%tones%n_tones))
         do i = 1, size(known)
            do copy = 0, n_copies - 1
               phases = [(modulo(copy/model%tones%subharmonic**(m - 1), model%tones%subharmonic), m=1, model%tones%n_tones)]
               phases = two_pi/model%tones%subharmonic*phases
               x = carry(known(i)%level%set, model%harmonics, known(i)%x, 1)
               if (copy > 0) x(:n) = shifted(x(:n), model%harmonics, phases)
               motions = reshape([motions, x], [n + 1, size(motions, 2) + 1])
            end do
         end do
      end associate
   end function motions_of
end module hb_motions_apart
