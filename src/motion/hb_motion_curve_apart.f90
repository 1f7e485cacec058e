!> Motions apart from all curves followed so far, at values at which they are asked for: each starts a curve of its own.
submodule (hb_motion_curve) hb_motion_curve_apart
   use hb_bordered, only: bordered_problem_t, new_bordered_problem
   use hb_kinds, only: two_pi
   use hb_other_motions, only: find_other, shifted
   use hb_solver_types, only: solver_config_t
   implicit none

   integer, parameter :: most_iterations = 40                         ! from one guess

contains

   module subroutine motion_curve_look_apart(self)
      class(motion_curve_t), intent(inout), target :: self
      type(bordered_problem_t) :: held
      type(solver_config_t) :: config
      real(wp), allocatable :: known(:, :)
      real(wp) :: form(self%problem%n_unknowns + 1, 1), x(self%problem%n_unknowns + 1)
      integer :: i
      logical :: is_found, is_possible

      if (.not. allocated(self%request%others)) return
      config = self%problem%scene%solver
      config%max_iterations = most_iterations
      form = 0.0_wp
      form(size(x), 1) = 1.0_wp
      do i = 1, size(self%request%others)
         known = known_at(self, self%request%others(i))
         if (size(known, 2) == 0) cycle                               ! nothing to begin with
         call self%move(known(:, 1), is_possible)
         if (.not. is_possible) cycle
         call new_bordered_problem(held, self%problem, self%which, form, self%request%others(i:i))
         config%tolerance = max(self%problem%scene%solver%tolerance, &
                                2.0_wp*self%problem%rounding_level(known(:self%problem%n_unknowns, 1)))
         call find_other(held, config, self%problem%scene%harmonics, known, x, is_found)
         if (.not. is_found) cycle
         x(size(x)) = self%request%others(i)
         call self%note_apart(x)
         return
      end do
   end subroutine motion_curve_look_apart

   !> Motions met at a value, and the same ones shifted by periods of what drives them.
   function known_at(self, value) result(known)
      class(motion_curve_t), intent(in) :: self
      real(wp), intent(in) :: value
      real(wp), allocatable :: known(:, :)
      real(wp), allocatable :: phases(:)
      real(wp) :: x(self%problem%n_unknowns + 1)
      integer :: copy, i, m, n_copies

      associate (scene => self%problem%scene, n => self%problem%n_unknowns)
         n_copies = scene%tones%subharmonic**scene%tones%n_tones
         allocate (known(n + 1, 0), phases(scene%tones%n_tones))
         do i = 1, size(self%met)
            if (abs(self%met(i)%x(n + 1) - value) > 0.0_wp) cycle
            do copy = 0, n_copies - 1
               phases = [(modulo(copy/scene%tones%subharmonic**(m - 1), scene%tones%subharmonic), m=1, scene%tones%n_tones)]
               phases = two_pi/scene%tones%subharmonic*phases
               x = self%met(i)%x
               if (copy > 0) x(:n) = shifted(x(:n), scene%harmonics, phases)
               known = reshape([known, x], [n + 1, size(known, 2) + 1])
            end do
         end do
      end associate
   end function known_at
end submodule hb_motion_curve_apart
