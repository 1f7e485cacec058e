!> Self-excited motion: limit cycles and tori with unknown base frequencies, from the modes of the base motion,
!> excluding the base motion itself. Source: docs/why/theory.md, section 6.5.
!> Search of a torus for several unknown tones: amplitudes follow the artificial damping, as the motion would grow or
!> decay in time, averaged over the fast oscillation. If the base motion is stable, a scan of amplitudes first
!> searches for driving. Source: docs/why/theory.md, section 6.5.
module hb_self_excitation
   use hb_advice, only: advice
   use hb_amplitude_curve, only: follow_curve
   use hb_cancellation, only: work_is_over
   use hb_kinds, only: wp
   use hb_limit_cycle_search, only: first_amplitude, last_amplitude, max_steps, path_point_t, search_t
   use hb_outcome, only: outcome
   use hb_text, only: to_text
   use hb_thresholds, only: negligible_step, rounding_level, small_share
   implicit none
   private
   public :: search_from_modes

   real(wp), parameter :: largest_amplitude = 1.0e8_wp                ! beyond: grows without bound
   real(wp), parameter :: longest_growth = 1.1_wp                     ! of log(amplitude) in one step

contains

   !> Searches from the modes of the search. If nothing is found, u is the motion at rest, and status and message give
   !> the reason.
   subroutine search_from_modes(self, u, is_found)
      type(search_t), intent(inout) :: self
      real(wp), intent(out) :: u(:, :)                                !! [m], (n_coefficients, n_dofs)
      logical, intent(out) :: is_found
      type(path_point_t) :: point

      self%is_neutral = .true.
      self%is_left = .false.
      self%is_driven = .false.
      self%runs_away = .false.
      self%reached = 0.0_wp
      self%report%status = outcome%pending
      if (allocated(self%message)) deallocate (self%message)
      if (size(self%tones) == 1) then
         call follow_curve(self, point, is_found)
      else
         call follow_flow(self, point, is_found)
      end if
      u = self%base%u
      if (is_found) then
         u = point%u
         return
      end if
      self%report%residual = self%base%report%residual
      if (allocated(self%message) .and. self%report%status == outcome%stalled) return
      self%report%status = outcome%no_motion
      if (.not. self%runs_away .and. (self%base%is_forced .or. size(self%tones) > 1)) self%report%status = outcome%collapsed
      if (allocated(self%message)) return
      if (self%reached <= 0.0_wp) then
         self%report%status = outcome%stalled
         self%message = "no starting motion with small amplitudes of the unknown tones was found"
      else if (self%is_neutral) then
         self%message = "the unknown tone is neither excited nor damped"
         self%advice = advice%given_amplitude
      else
         self%message = "damped at the amplitudes tried, "//to_text(self%length*first_amplitude)//" to "//to_text(self%reached)
      end if
   end subroutine search_from_modes

   !> Searches for a motion that contains all unknown tones. Without success the search contains the largest
   !> amplitude, and a message if the motion was lost.
   subroutine follow_flow(self, point, is_found)
      type(search_t), intent(inout) :: self
      type(path_point_t), intent(out) :: point                         !! the motion found, otherwise the last point
      logical, intent(out) :: is_found
      type(path_point_t) :: last
      real(wp) :: goal
      logical :: is_solved

      is_found = .false.
      goal = self%length*first_amplitude
      call self%begin(goal, point, is_solved)
      do while (is_solved .and. .not. work_is_over())
         last = point
         self%reached = goal
         self%is_neutral = self%is_neutral .and. all(abs(self%damping(point)) <= rounding_level)
         if (any(self%damping(point) < -rounding_level)) then
            call remove_damping(self, point, is_found)
            return
         end if
         goal = exp(longest_growth)*goal
         if (goal > last_amplitude*self%length) return
         call approach(self, last, spread(goal, 1, size(self%tones)), point, is_solved)
      end do
   end subroutine follow_flow

   !> Lets the amplitudes follow the artificial damping until that nearly vanishes, then tries the motion without it.
   subroutine remove_damping(self, now, is_found)
      type(search_t), intent(inout) :: self
      type(path_point_t), intent(inout) :: now
      logical, intent(out) :: is_found
      type(path_point_t) :: last, trial
      real(wp), dimension(size(self%tones)) :: growth, sign_before
      real(wp) :: next_try, smallest
      integer :: step
      logical :: has_turned(size(self%tones)), is_solved

      self%report%status = outcome%pending
      has_turned = .false.
      smallest = min(minval(now%amplitude), first_amplitude*self%length)
      growth = longest_growth
      sign_before = sign(1.0_wp, self%damping(now))
      next_try = small_share                                          ! |xi|/omega
      do step = 1, max_steps
         is_found = .false.
         if (work_is_over()) exit
         if (all(has_turned) .and. maxval(abs(self%damping(now))) <= next_try) then
            trial = now
            call self%try_motion(trial, is_found)
            if (is_found) now = trial
            if (is_found) return
            next_try = 0.3_wp*maxval(abs(self%damping(now)))
         end if
         if (maxval(now%amplitude) > largest_amplitude*self%length) then
            self%message = "self-excited at all amplitudes tried: the motion grows without bound"
            self%runs_away = .true.
            return
         end if
         if (any(now%amplitude < 0.3_wp*smallest .and. self%damping(now) > 0.0_wp)) then
            self%message = "the motion of one unknown tone vanishes in the presence of another"
            return
         end if
         last = now
         call approach(self, last, last%amplitude*exp(-sign(growth, self%damping(last))), now, is_solved)
         if (is_solved) then
            where (sign(1.0_wp, self%damping(now)) == sign_before)
               growth = min(longest_growth, 1.3_wp*growth)
            else where
               growth = 0.3_wp*growth
               has_turned = .true.
            end where
            sign_before = sign(1.0_wp, self%damping(now))
         else
            now = last
            growth = 0.3_wp*growth
         end if
         if (maxval(growth) < negligible_step) exit
      end do
      self%report%status = outcome%stalled
      self%message = "continuation to the motion failed at amplitude "//to_text(maxval(now%amplitude))//" and damping xi/omega "// &
                     to_text(maxval(abs(self%damping(now))))
   end subroutine remove_damping

   !> Solves at other amplitudes from the point `last`, with smaller steps if the whole one fails. `now` is the last
   !> point.
   subroutine approach(self, last, goal, now, is_solved)
      type(search_t), intent(inout) :: self
      type(path_point_t), intent(in) :: last
      real(wp), intent(in) :: goal(:)                                 !! [m], (unknown tones)
      type(path_point_t), intent(out) :: now
      logical, intent(out) :: is_solved
      integer, parameter :: max_solutions = 24
      type(path_point_t) :: trial
      real(wp) :: share
      integer :: i

      now = last
      share = 1.0_wp
      do i = 1, max_solutions
         trial = now
         trial%amplitude = now%amplitude*(goal/now%amplitude)**share
         call scale_tones(self, now, trial)
         call self%solve_with_amplitudes(trial, .false., is_solved)
         if (is_solved) then
            now = trial
            if (share >= 1.0_wp) return
            share = 1.0_wp
         else
            share = 0.4_wp*share
            if (share < 1.0e-3_wp) return
         end if
      end do
      is_solved = .false.
   end subroutine approach

   !> Predictor: each harmonic grows with the unknown tone that has the largest entry in it.
   subroutine scale_tones(self, from, to)
      type(search_t), intent(in) :: self
      type(path_point_t), intent(in) :: from
      type(path_point_t), intent(inout) :: to
      integer :: h, m

      associate (set => self%balance%harmonics)
         do h = 1, set%n_harmonics
            associate (j => set%tuples(self%tones, h))
               if (all(j == 0)) cycle
               m = maxloc(abs(j), dim=1)
               to%u(set%cos_at(h), :) = from%u(set%cos_at(h), :)*to%amplitude(m)/from%amplitude(m)
               to%u(set%sin_at(h), :) = from%u(set%sin_at(h), :)*to%amplitude(m)/from%amplitude(m)
            end associate
         end do
      end associate
   end subroutine scale_tones
end module hb_self_excitation
