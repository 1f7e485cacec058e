!> A step of a curve, as long as the curve is followed on it and what is found on it can be located.
submodule (hb_motion_curve) hb_motion_curve_step
   use hb_bordered, only: bordered_problem_t
   use hb_curve_conditions, only: is_mirrored, set_conditions
   use hb_newton, only: solve_newton
   implicit none

   real(wp), parameter :: largest_turn = 0.6_wp                       ! [rad] on a step, unless it is short
   real(wp), parameter :: longest_chord = 2.0_wp                      ! of a step, unless it is short: 1.05 with the largest turn
   real(wp), parameter :: short = 1.0e-2_wp                           ! of the longest step
   real(wp), parameter :: shortest_leap = 1.0e-4_wp                   ! of the longest step: the corner at which a curve may leap
                                                                      ! is as long as the root of the damping
   real(wp), parameter :: least_amplitude = 1.0e-3_wp                 ! of the largest: of harmonics whose phases are looked at
   real(wp), parameter :: largest_phase = 0.5_wp                      ! its cosine; a phase may change by 60 degrees on a step
   real(wp), parameter :: off_the_chord = 0.5_wp                      ! of an amplitude, in the middle of a step
   real(wp), parameter :: off_the_line = 0.25_wp                      ! of a step, likewise: an arc that turns by 0.6 has 0.075
   integer, parameter :: most_middles = 4                             ! points at which one step is looked at

contains

   module procedure motion_curve_step
      real(wp), allocatable :: extremes(:, :), slopes(:)
      type(stability_t) :: stability
      real(wp) :: largest, units(size(self%curve%x))
      integer :: n_branch_points
      logical :: is_lost, is_near, is_possible, is_short, is_taken

      if (allocated(self%problem%complaint)) deallocate (self%problem%complaint)
      call self%move(self%curve%x, is_possible)
      call self%problem%renew()                                       ! a stored curve, too, goes on from there
      self%slack = 1.0_wp
      call set_conditions(self%problem, self%which, self%curve, self%weights)
      associate (curve => self%curve)
         do
            largest = self%largest
            units = curve%units
            n_branch_points = curve%n_branch_points
            call curve%advance()
            if (curve%status == outcome%stalled) call try_end(self)
            if (curve%status == outcome%stalled .and. self%is_uneven .and. self%slack < most_slack) then
               self%slack = 10.0_wp*self%slack
               call self%renew()
               curve%status = outcome%pending
               curve%step = curve%config%first_step
               cycle
            end if
            if (curve%status /= outcome%pending .or. size(self%waiting) >= self%first_waiting) return
            call self%renew()
            call curve%turn()
            is_short = curve%last_step <= short*curve%config%longest_step
            is_near = norm2((curve%x - curve%last_x)/curve%units) <= longest_chord*curve%last_step
            is_taken = is_short .or. (curve%angle <= largest_turn .and. is_near)
            if (is_taken) is_taken = .not. has_leapt(self)
            if (is_taken) then
               self%has_collapsed = is_mirrored(self%problem, self%which, self%curve, self%weights)
               if (self%has_collapsed) then
                  curve%status = outcome%collapsed
                  return
               end if
               slopes = self%slopes_along()
               self%waiting = [waiting_t ::]
               self%first_waiting = 1
               call find_stability(self%problem, self%which, curve%x, self%problem%scene%stability%tolerance, stability)
               call find_extremes(self%problem, self%which, curve%x, extremes)
               call self%look_back(slopes, stability, extremes, curve%n_branch_points > n_branch_points, is_lost)
               if (is_short .or. self%is_uneven .or. .not. is_lost) exit
               self%waiting = [waiting_t ::]
            end if
            call curve%retreat()
            if (curve%status == outcome%stalled) call try_end(self)
            if (curve%status /= outcome%pending .or. size(self%waiting) >= self%first_waiting) return
            self%largest = largest
            curve%units = units
         end do
         self%slopes = slopes
         self%stability = stability
         call move_alloc(extremes, self%extremes)
      end associate
   end procedure motion_curve_step

   !> Lands on an end of the range that is ahead and so near that no step fits in between: there may be nothing beyond.
   subroutine try_end(self)
      class(motion_curve_t), intent(inout), target :: self
      real(wp), parameter :: very_near = 1.0e-4_wp                    ! of the range
      real(wp) :: ends(2), gap, x(size(self%curve%x))
      integer :: i, n
      logical :: is_there

      n = size(x)
      ends = [self%request%from, self%request%to]
      do i = 1, size(ends)
         associate (curve => self%curve)
            gap = ends(i) - curve%x(n)
            if (abs(gap) > very_near*curve%units(n) .or. .not. gap*curve%direction(n) > 0.0_wp) cycle
            x = curve%x + gap/curve%direction(n)*curve%direction
            x(n) = ends(i)
            call self%land(x, is_there)
            if (.not. is_there) cycle
            curve%status = outcome%pending
            deallocate (self%waiting)
            allocate (self%waiting(1))
            self%waiting(1)%kind = curve_kind%end
            self%waiting(1)%place = norm2((x - curve%x)/curve%units)
            self%waiting(1)%x = x
            self%first_waiting = 1
            return
         end associate
      end do
   end subroutine try_end

   !> Whether the step may have led to another part of the curve or to another curve, or over a narrow resonance.
   !>
   !> With little damping two parts come close where a coefficient is nearly zero, and go on in each other's direction: neither
   !> tangents nor determinants show a leap from one to the other, but the phase of the coefficient turns by half a turn. It does so
   !> also where the coefficient goes through zero. So the curve is looked at in between, where the chord comes closest to zero: it
   !> must be there, and not far from the chord.
   logical function has_leapt(self)
      class(motion_curve_t), intent(inout), target :: self
      complex(wp) :: before, behind
      real(wp) :: middles(most_middles), share, size_of_motion, x(size(self%curve%x))
      integer :: d, h, n_middles
      logical :: is_on_curve

      has_leapt = .false.
      if (self%curve%last_step <= shortest_leap*self%curve%config%longest_step .or. self%is_uneven) return
      if (size(self%which) > 1) return                                ! tones of the motion's own have no given phases
      n_middles = 0
      associate (curve => self%curve, set => self%problem%scene%harmonics, n => self%problem%n_unknowns)
         size_of_motion = maxval(abs(curve%x(:n)/self%weights))
         do h = 1, set%n_harmonics
            do d = 0, self%problem%balance%n_dofs - 1
               if (set%sin_at(h) == 0) cycle
               before = coefficient_of(curve%last_x)
               behind = coefficient_of(curve%x)
               if (max(abs(before), abs(behind)) < least_amplitude*size_of_motion) cycle
               if (real(conjg(before)*behind) >= largest_phase*abs(before)*abs(behind)) cycle
               share = real(conjg(before)*(before - behind))/abs(before - behind)**2
               if (n_middles == most_middles .or. share <= 0.0_wp .or. share >= 1.0_wp) cycle
               if (any(abs(middles(:n_middles) - share) < 0.1_wp)) cycle
               n_middles = n_middles + 1
               middles(n_middles) = share
               call curve%point_at(share*curve%last_step, x, is_on_curve)
               has_leapt = .not. is_on_curve
               if (.not. has_leapt) has_leapt = norm2((x - (curve%last_x + share*(curve%x - curve%last_x)))/curve%units) > &
                                                off_the_line*curve%last_step
               if (.not. has_leapt) has_leapt = abs(coefficient_of(x) - (before + share*(behind - before))) > &
                                                off_the_chord*max(abs(before), abs(behind))
               if (has_leapt .or. curve%status /= outcome%pending) return
            end do
         end do
      end associate

   contains

      pure complex(wp) function coefficient_of(x)
         real(wp), intent(in) :: x(:)

         associate (set => self%problem%scene%harmonics)
            associate (c => d*set%n_coefficients + set%cos_at(h), s => d*set%n_coefficients + set%sin_at(h))
               coefficient_of = cmplx(x(c)/self%weights(c), x(s)/self%weights(s), wp)
            end associate
         end associate
      end function coefficient_of
   end function has_leapt

   module procedure motion_curve_land
      type(bordered_problem_t) :: problem
      type(report_t) :: report
      real(wp), parameter :: near = 1.0e-6_wp
      real(wp) :: there(size(x))
      integer :: last

      problem = self%curve%problem
      last = size(self%which)
      problem%forms(:, last) = 0.0_wp
      problem%forms(size(x), last) = 1.0_wp
      problem%values(last) = x(size(x))
      call problem%rescale()
      there = x
      call solve_newton(problem, self%curve%corrector, there, report)
      call self%curve%report%add(report)
      there(size(x)) = x(size(x))
      is_there = report%status == outcome%converged .and. maxval(abs(there - x)/self%curve%units) < near   ! at a fold it may not
      if (is_there) x = there
   end procedure motion_curve_land

end submodule hb_motion_curve_step
